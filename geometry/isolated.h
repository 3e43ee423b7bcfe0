#pragma once

#include <functional>
#include <string>

namespace gantry::internal {

/// Runs `work` in a forked copy of this process and returns the bytes that it returned. For libraries that a
/// damaged file can crash or hang: whatever becomes of the copy, this process goes on. Throws InputError
/// "`what`: ..." with what `work` threw, or that it crashed, or that it took longer than `timeout_s`.
/// `work` must not rely on other threads: the copy has none.
std::string run_isolated(const std::function<std::string()>& work, double timeout_s, const std::string& what);

}  // namespace gantry::internal
