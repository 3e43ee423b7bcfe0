#include "isolated.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <stdexcept>

#include "foundation/expect_input_error.h"

namespace gantry::internal {
namespace {

TEST(Isolated, ReturnsWhatTheWorkReturned) {
  EXPECT_EQ(run_isolated([] { return std::string("answer"); }, 10, "a.step"), "answer");
  EXPECT_EQ(run_isolated([] { return std::string(); }, 10, "a.step"), "");
  // More than a pipe holds, every byte value in it.
  std::string large(3'000'000, '\0');
  for (size_t i = 0; i < large.size(); ++i) large[i] = static_cast<char>(i * 7 % 256);
  EXPECT_EQ(run_isolated([&] { return large; }, 10, "a.step"), large);
}

TEST(Isolated, WhateverBecomesOfTheCopyIsAnInputError) {
  const auto refused = [](const std::function<std::string()>& work, const std::string& complaint) {
    expect_input_error([&] { run_isolated(work, 0.3, "bad.step"); }, {"bad.step: ", complaint});
  };
  refused([]() -> std::string { throw std::runtime_error("line 3 is wrong"); }, "line 3 is wrong");
  refused([]() -> std::string { throw 7; }, "refused");
  refused(
      []() -> std::string {
        ::raise(SIGKILL);
        return "x";
      },
      "crashed");
  refused([]() -> std::string { ::_exit(3); }, "crashed");
  refused([]() -> std::string { ::_exit(0); }, "crashed");
  refused(
      []() -> std::string {
        for (;;) ::pause();
      },
      "took longer");
}

TEST(Isolated, WhatTheCopyPrintsIsLost) {
  ::testing::internal::CaptureStdout();
  std::printf("before ");
  run_isolated(
      [] {
        std::printf("chatter");
        std::fflush(stdout);
        return std::string();
      },
      10, "a.step");
  std::printf("after");
  EXPECT_EQ(::testing::internal::GetCapturedStdout(), "before after");
}

}  // namespace
}  // namespace gantry::internal
