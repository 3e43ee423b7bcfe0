#pragma once

#include <termios.h>

namespace gantry {

enum class JogKey { kNone, kForward, kBackward, kStop, kQuit };

/// The keyboard without Enter and without echo, until the object goes.
class JogKeys {
 public:
  JogKeys();
  ~JogKeys();
  JogKeys(const JogKeys&) = delete;
  JogKeys& operator=(const JogKeys&) = delete;

  /// Waits up to `timeout_s` for a key. Of several that wait, the last one counts; the end of the input is
  /// kQuit.
  JogKey wait(double timeout_s);

 private:
  termios before_{};
};

}  // namespace gantry
