#pragma once

#include <string>

namespace gantry {

/// Whether a GigE Vision device answers a discovery command sent straight to `address` within about a
/// second. Aravis takes ten seconds and more to find that nobody is there. True for anything but an
/// IPv4 address: only Aravis can resolve a device id.
bool answers_discovery(const std::string& address);

}  // namespace gantry
