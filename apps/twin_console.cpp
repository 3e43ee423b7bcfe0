#include "twin_console.h"

#include <poll.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <array>
#include <charconv>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

constexpr size_t kLongestLine = 1000;

/// Whether stdin may be read: a background process that reads the terminal would be stopped by the system.
bool may_read_stdin() {
  if (isatty(STDIN_FILENO) && tcgetpgrp(STDIN_FILENO) != getpgrp()) return false;
  pollfd ready{STDIN_FILENO, POLLIN, 0};
  return ::poll(&ready, 1, 0) > 0 && (ready.revents & (POLLIN | POLLHUP)) != 0;
}

int channel_of(const std::string& word) {
  int channel = -1;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), channel);
  if (error != std::errc() || end != word.data() + word.size())
    throw InputError("expected the number of a channel, found '" + word + "'");
  return channel;
}

}  // namespace

void TwinConsole::execute(const std::string& line) {
  const size_t space = line.find(' ');
  const std::string verb = line.substr(0, space);
  const std::string object = space == std::string::npos ? "" : line.substr(space + 1);
  if (verb == "press")
    contacts_.press(object);
  else if (verb == "release")
    contacts_.release(object);
  else if (verb == "break")
    contacts_.break_wire(channel_of(object));
  else if (verb == "stick")
    contacts_.stick(channel_of(object));
  else if (verb == "mend")
    contacts_.mend(channel_of(object));
  else if (verb == "supply" && (object == "on" || object == "off"))
    contacts_.set_supply(object == "on");
  else
    throw InputError("unknown command '" + line + "'; known: " + kHelp);
}

void TwinConsole::poll() {
  while (!ended_ && may_read_stdin()) {
    std::array<char, 256> chunk;
    const ssize_t count = ::read(STDIN_FILENO, chunk.data(), chunk.size());
    if (count <= 0 || typed_.size() > kLongestLine) {
      ended_ = true;
      return;
    }
    typed_.append(chunk.data(), static_cast<size_t>(count));
    for (size_t end; (end = typed_.find('\n')) != std::string::npos; typed_.erase(0, end + 1)) {
      const std::string line = typed_.substr(0, end);
      if (line.empty()) continue;
      try {
        execute(line);
        spdlog::info("{}", line);
      } catch (const InputError& e) {
        spdlog::warn("{}", e.what());
      }
    }
  }
}

}  // namespace gantry
