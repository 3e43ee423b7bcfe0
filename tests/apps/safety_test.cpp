// What a person at the cell sees of the collision check and of the safety inputs: gantry-cell refuses a plan
// that collides, and gantry-twin's contacts are pressed from its stdin.

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <thread>

#include "apps/process.h"
#include "apps/test_cell.h"
#include "gantry/hal/modbus_safety_inputs.h"

namespace gantry::testing {
namespace {

constexpr char kSwingingPlan[] =
    "name: swinging\n"
    "exposure_ms: 20\n"
    "inspection: { tolerance_mm: 0.2 }\n"
    "viewpoints:\n"
    "  - { name: rear, joints: { linear_mm: 290, rotation_deg: 0, tilt_deg: 0 } }\n"
    "  - { name: turned round, joints: { linear_mm: 290, rotation_deg: 180, tilt_deg: 0 } }\n";

TEST(CollisionCheck, APlanThatCollidesIsRefusedBeforeAnythingIsOpened) {
  TemporaryFolder folder;
  write_text(folder / "cell.yaml",
             twin_cell_text());  // no twin runs: a device that is asked would be a fault
  write_text(folder / "plan.yaml", kSwingingPlan);
  const ProcessResult run = run_program("gantry-cell", {"run", "--cell", folder / "cell.yaml", "--plan",
                                                        folder / "plan.yaml", "--out", folder / "run"});
  EXPECT_EQ(run.exit_code, 2) << run.out << run.err;
  for (const char* part : {"plan.yaml", "viewpoint 'turned round' is refused", "'rear'", "'turntable'",
                           "'rear brace'", "rotation", "nothing has moved"})
    EXPECT_NE(run.err.find(part), std::string::npos) << part << " is not in: " << run.err;
  EXPECT_FALSE(std::filesystem::exists(folder / "run"));
}

/// gantry-twin with a pipe for its stdin.
class TypedTwin {
 public:
  explicit TypedTwin(const std::string& cell) {
    int input[2], output[2];
    if (pipe(input) != 0 || pipe(output) != 0) throw std::runtime_error("no pipe");
    const std::string program = std::string(GANTRY_BIN_DIR) + "/gantry-twin";
    pid_ = fork();
    if (pid_ == 0) {
      dup2(input[0], STDIN_FILENO);
      dup2(output[1], STDOUT_FILENO);
      for (const int fd : {input[0], input[1], output[0], output[1]}) ::close(fd);
      execl(program.c_str(), "gantry-twin", "--cell", cell.c_str(), "--log-level", "off", nullptr);
      _exit(127);
    }
    ::close(input[0]);
    ::close(output[1]);
    typed_ = input[1];
    char ready[6] = {};
    for (size_t have = 0; have < 6;) {  // "ready\n", or the end of the program
      const ssize_t count = read(output[0], ready + have, 6 - have);
      if (count <= 0) break;
      have += static_cast<size_t>(count);
    }
    ::close(output[0]);
    ready_ = std::string(ready, 6) == "ready\n";
  }
  ~TypedTwin() {
    ::close(typed_);
    kill(pid_, SIGTERM);
    waitpid(pid_, nullptr, 0);
  }
  bool ready() const { return ready_; }
  void type(const std::string& text) const {
    ASSERT_EQ(write(typed_, text.data(), text.size()), std::ssize(text));
  }

 private:
  pid_t pid_ = -1;
  int typed_ = -1;
  bool ready_ = false;
};

TEST(TwinConsole, TypedCommandsReachTheContacts) {
  TemporaryFolder folder;
  write_text(folder / "cell.yaml", small_twin_cell_text());
  const TypedTwin twin(folder / "cell.yaml");
  ASSERT_TRUE(twin.ready());
  ModbusSafetyInputsConfig config;
  config.host = "127.0.0.1";
  config.port = 15123;
  config.unit = 10;
  config.channels = {0, 1, 2, 3, 4, 5};
  config.response_timeout_s = 5;
  const auto inputs = make_modbus_safety_inputs(config, nullptr);
  // The twin looks at its stdin twenty times a second.
  const auto become = [&](const std::string& expected) {
    std::string text;
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    do {
      const auto levels = inputs->read();
      if (!levels) return levels.error().text();
      text.clear();
      for (const bool level : *levels) text += level ? '1' : '0';
      if (text == expected) return text;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    } while (std::chrono::steady_clock::now() < give_up);
    return text;
  };
  EXPECT_EQ(become("111111"), "111111");
  twin.type("press emergency stop\n");
  EXPECT_EQ(become("001111"), "001111");
  twin.type("break 4\nnonsense\npress window\nbreak 99\nbreak x\n\nstick 2\npress door\n");
  EXPECT_EQ(become("001001"), "001001") << "wrong lines are no harm";
  twin.type("release emergency ");
  twin.type("stop\nmend 4\nmend 2\n");
  EXPECT_EQ(become("110011"), "110011");
  twin.type("supply off\n");
  EXPECT_EQ(become("000000"), "000000");
}

}  // namespace
}  // namespace gantry::testing
