#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "gantry/foundation/error.h"

namespace gantry {

/// Expects `action` to throw InputError with a message that contains every one of `parts`.
template <class Action>
void expect_input_error(Action&& action, const std::vector<std::string>& parts) {
  try {
    action();
    ADD_FAILURE() << "no InputError; expected one that says " << ::testing::PrintToString(parts);
  } catch (const InputError& error) {
    for (const auto& part : parts)
      EXPECT_NE(std::string(error.what()).find(part), std::string::npos)
          << "'" << part << "' is not in: " << error.what();
  } catch (const std::exception& error) {
    ADD_FAILURE() << "another exception than InputError: " << error.what();
  }
}

}  // namespace gantry
