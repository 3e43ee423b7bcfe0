#include "jog_keys.h"

#include <poll.h>
#include <unistd.h>

#include <string_view>

namespace gantry {

JogKeys::JogKeys() {
  tcgetattr(STDIN_FILENO, &before_);
  termios raw = before_;
  raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  raw.c_cc[VMIN] = 0;
  raw.c_cc[VTIME] = 0;
  tcsetattr(STDIN_FILENO, TCSANOW, &raw);
}

JogKeys::~JogKeys() {
  tcsetattr(STDIN_FILENO, TCSAFLUSH, &before_);
}

JogKey JogKeys::wait(double timeout_s) {
  pollfd events{STDIN_FILENO, POLLIN, 0};
  if (poll(&events, 1, static_cast<int>(timeout_s * 1e3)) <= 0) return JogKey::kNone;
  char bytes[64];
  const ssize_t count = read(STDIN_FILENO, bytes, sizeof bytes);
  if (count <= 0) return JogKey::kQuit;
  std::string_view rest(bytes, static_cast<size_t>(count));
  JogKey key = JogKey::kNone;
  while (!rest.empty()) {
    size_t length = 1;
    if (rest.substr(0, 3) == "\033[C" || rest.substr(0, 3) == "\033[A") {
      key = JogKey::kForward;
      length = 3;
    } else if (rest.substr(0, 3) == "\033[D" || rest.substr(0, 3) == "\033[B") {
      key = JogKey::kBackward;
      length = 3;
    } else if (rest[0] == '+') {
      key = JogKey::kForward;
    } else if (rest[0] == '-') {
      key = JogKey::kBackward;
    } else if (rest[0] == 'q' || rest[0] == '\033' || rest[0] == '\004') {
      return JogKey::kQuit;
    } else {
      key = JogKey::kStop;  // Any other key: whoever hits the keyboard wants it to stop.
    }
    rest.remove_prefix(length);
  }
  return key;
}

}  // namespace gantry
