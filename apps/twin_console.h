#pragma once

#include <string>

#include "gantry/sim/safety_contacts.h"

namespace gantry {

/// What a person can do to the safety contacts of a running twin: one command on a line of stdin.
///   press NAME | release NAME            press emergency stop
///   break CHANNEL | stick CHANNEL | mend CHANNEL
///   supply on | supply off
class TwinConsole {
 public:
  static constexpr const char* kHelp =
      "press NAME, release NAME, break CHANNEL, stick CHANNEL, mend CHANNEL, supply on, supply off";

  /// `contacts` must outlive the console.
  explicit TwinConsole(SafetyContacts& contacts) : contacts_(contacts) {}

  /// Carries out what has been typed since the last call; never waits. Wrong commands are answered by a
  /// warning.
  void poll();
  /// One line. Throws InputError for what is no command.
  void execute(const std::string& line);

 private:
  SafetyContacts& contacts_;
  std::string typed_;
  bool ended_ = false;
};

}  // namespace gantry
