// gantry-cell home, jog, status and reset as a person types them, against gantry-twin; and the keys of jog in
// a terminal of the test's own.

#include <gtest/gtest.h>
#include <poll.h>
#include <pty.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <nlohmann/json.hpp>
#include <thread>

#include "apps/process.h"
#include "apps/test_cell.h"

namespace gantry::testing {
namespace {

class MotionCommandsTest : public ::testing::Test {
 protected:
  MotionCommandsTest() { write_text(folder_ / "cell.yaml", small_twin_cell_text()); }

  ProcessResult cell(std::vector<std::string> arguments, double timeout_s = 60) {
    arguments.insert(arguments.begin() + 1, {"--cell", folder_ / "cell.yaml"});
    return run_program("gantry-cell", arguments, timeout_s);
  }
  nlohmann::json status() {
    const ProcessResult shown = cell({"status", "--json"});
    EXPECT_EQ(shown.exit_code, 0) << shown.err;
    return nlohmann::json::parse(shown.out);
  }

  TemporaryFolder folder_;
};

TEST_F(MotionCommandsTest, OneAxisIsHomedAndMovedByHandTheOthersAreRefused) {
  BackgroundProgram twin("gantry-twin", {"--cell", folder_ / "cell.yaml"});
  ASSERT_TRUE(twin.wait_for_line("ready", 60));
  const ProcessResult homed = cell({"home", "--axis", "linear"});
  ASSERT_EQ(homed.exit_code, 0) << homed.err;
  EXPECT_NE(homed.out.find("homed: linear\n"), std::string::npos) << homed.out;
  nlohmann::json now = status();
  EXPECT_TRUE(now["axes"][0]["homed"].get<bool>());
  EXPECT_FALSE(now["axes"][2]["homed"].get<bool>());
  EXPECT_EQ(now["axes"][0]["unit"], "mm");

  const ProcessResult moved = cell({"jog", "--axis", "linear", "--by", "12.5"});
  EXPECT_EQ(moved.exit_code, 0) << moved.err;
  EXPECT_NEAR(status()["axes"][0]["position"].get<double>(), 12.5, 0.05);
  const ProcessResult too_far = cell({"jog", "--axis", "linear", "--by", "400"});
  EXPECT_EQ(too_far.exit_code, 3);
  EXPECT_NE(too_far.err.find("outside the soft limits 5.00 mm to 295.00 mm"), std::string::npos)
      << too_far.err;
  const ProcessResult unhomed = cell({"jog", "--axis", "tilt", "--by", "1"});
  EXPECT_EQ(unhomed.exit_code, 3);
  EXPECT_NE(unhomed.err.find("run gantry-cell home --axis tilt"), std::string::npos) << unhomed.err;

  const ProcessResult unknown = cell({"home", "--axis", "yaw"});
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_NE(unknown.err.find("it has linear, rotation, tilt"), std::string::npos) << unknown.err;
  const ProcessResult no_terminal = cell({"jog", "--axis", "linear"});
  EXPECT_EQ(no_terminal.exit_code, 2);
  EXPECT_NE(no_terminal.err.find("--by"), std::string::npos) << no_terminal.err;
}

TEST_F(MotionCommandsTest, OneProcessControlsACellAndStatusShowsItsFigures) {
  BackgroundProgram twin("gantry-twin", {"--cell", folder_ / "cell.yaml"});
  ASSERT_TRUE(twin.wait_for_line("ready", 60));
  BackgroundProgram homing("gantry-cell", {"home", "--cell", folder_ / "cell.yaml"});
  nlohmann::json live;
  for (int i = 0; i < 200 && (live.is_null() || live["loop"].is_null()); ++i) {
    const ProcessResult shown = cell({"status", "--json"});
    if (shown.exit_code == 0) live = nlohmann::json::parse(shown.out);
  }
  ASSERT_FALSE(live.is_null());
  EXPECT_EQ(live["command"], "gantry-cell home");
  ASSERT_FALSE(live["loop"].is_null()) << "only the process with the loop knows its figures";
  EXPECT_GE(live["loop"]["late_us"]["max"].get<double>(), live["loop"]["late_us"]["p50"].get<double>());
  const ProcessResult second = cell({"jog", "--axis", "linear", "--by", "1"});
  EXPECT_EQ(second.exit_code, 3);
  EXPECT_NE(second.err.find("controlled by gantry-cell home (process "), std::string::npos) << second.err;
  EXPECT_EQ(homing.wait(), 0);
  EXPECT_EQ(cell({"reset"}).exit_code, 0) << "free again";
}

/// gantry-cell in a terminal: what it prints, and keys for it.
class Terminal {
 public:
  explicit Terminal(std::vector<std::string> arguments) {
    const std::string program = std::string(GANTRY_BIN_DIR) + "/gantry-cell";
    arguments.insert(arguments.begin(), program);
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    pid_ = ::forkpty(&terminal_, nullptr, nullptr, nullptr);
    if (pid_ == 0) {
      ::execv(program.c_str(), argv.data());
      ::_exit(127);
    }
  }
  ~Terminal() {
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);
      ::waitpid(pid_, nullptr, 0);
    }
    ::close(terminal_);
  }

  void type(const std::string& keys) {
    [[maybe_unused]] const ssize_t count = ::write(terminal_, keys.data(), keys.size());
  }
  /// Reads for so long, or until the text has been seen.
  bool read_until(const std::string& wanted, double timeout_s) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
    while (seen.find(wanted) == std::string::npos && std::chrono::steady_clock::now() < end) {
      pollfd events{terminal_, POLLIN, 0};
      if (::poll(&events, 1, 20) <= 0) continue;
      char bytes[4096];
      const ssize_t count = ::read(terminal_, bytes, sizeof bytes);
      if (count <= 0) break;
      seen.append(bytes, static_cast<size_t>(count));
    }
    return seen.find(wanted) != std::string::npos;
  }
  int wait() {
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

  std::string seen;

 private:
  pid_t pid_ = -1;
  int terminal_ = -1;
};

/// "linear stands at 12.34 mm": the number.
double position_in(const std::string& text) {
  const size_t at = text.rfind("stands at ");
  return at == std::string::npos ? std::nan("") : std::stod(text.substr(at + 10));
}

TEST_F(MotionCommandsTest, KeysMoveWhileTheyAreHeldAndNoLonger) {
  // In one process, where the axis may be jogged before homing; the same seed starts it at the same place.
  std::string text = simulated_cell_text();
  text =
      replaced(text, "      speed_mm_s: 120\n", "      speed_mm_s: 120\n      unhomed_jog_speed_mm_s: 10\n");
  write_text(folder_ / "cell.yaml", text);
  const std::vector<std::string> jog = {"jog", "--cell", folder_ / "cell.yaml", "--axis", "linear"};
  const ProcessResult here = cell({"jog", "--axis", "linear", "--by", "0.001"});
  ASSERT_EQ(here.exit_code, 0) << here.err;
  const double start = position_in(here.out);
  {
    Terminal terminal(jog);
    ASSERT_TRUE(terminal.read_until("hold the right or left arrow", 60)) << terminal.seen;
    for (int i = 0; i < 20; ++i) {  // Held for about a second: the terminal repeats the key.
      terminal.type("\033[C");
      terminal.read_until("never", 0.05);
    }
    terminal.read_until("never", 2);  // Let go: two more seconds would be 20 mm.
    terminal.type("q");
    ASSERT_TRUE(terminal.read_until("stands at", 20)) << terminal.seen;
    EXPECT_EQ(terminal.wait(), 0);
    const double moved = position_in(terminal.seen) - start;
    EXPECT_GT(moved, 4);
    EXPECT_LT(moved, 20);
  }
  {
    Terminal terminal(jog);
    ASSERT_TRUE(terminal.read_until("hold the right or left arrow", 60));
    for (int i = 0; i < 10; ++i) {
      terminal.type("-");
      terminal.read_until("never", 0.05);
    }
    terminal.type(" ");  // Any other key stops at once.
    terminal.read_until("never", 1);
    terminal.type("q");
    ASSERT_TRUE(terminal.read_until("stands at", 20)) << terminal.seen;
    EXPECT_LT(position_in(terminal.seen), start - 1);
    EXPECT_EQ(terminal.wait(), 0);
  }
}

}  // namespace
}  // namespace gantry::testing
