#include "gantry/acquisition/cell_session.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <fstream>
#include <thread>

#include "acquisition/edited_file.h"

namespace gantry {
namespace {

class CellSessionTest : public testing::Test {
 protected:
  CellSessionTest() {
    ::setenv("XDG_RUNTIME_DIR", (folder_ / "").c_str(), 1);
    std::ofstream(cell_) << "cell";
  }

  TempFolder folder_;
  std::filesystem::path cell_ = folder_ / "cell.yaml";
};

TEST_F(CellSessionTest, OneProcessHasACellAndTheNextIsToldWho) {
  {
    auto first = CellSession::open(cell_, "gantry-cell run");
    ASSERT_TRUE(first);
    const auto second = CellSession::open(cell_, "gantry-cell home", 0);
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().kind, FaultKind::kRefused);
    for (const std::string& expected :
         {std::string("gantry-cell run"), std::to_string(::getpid()), cell_.string()})
      EXPECT_NE(second.error().text().find(expected), std::string::npos) << second.error().text();
    std::ofstream(folder_ / "other.yaml") << "cell";
    EXPECT_TRUE(CellSession::open(folder_ / "other.yaml", "gantry-cell run", 0)) << "another cell is free";
    std::filesystem::create_symlink(cell_, folder_ / "link.yaml");
    EXPECT_FALSE(CellSession::open(folder_ / "link.yaml", "gantry-cell run", 0))
        << "the same cell by another name";
  }
  EXPECT_TRUE(CellSession::open(cell_, "gantry-cell home", 0)) << "free again";
}

TEST_F(CellSessionTest, APatientOneWaitsForTheOther) {
  std::optional<CellSession> first;
  first.emplace(std::move(*CellSession::open(cell_, "gantry-cell status")));
  std::thread leaving([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    first.reset();
  });
  EXPECT_TRUE(CellSession::open(cell_, "gantry-cell home", 10));
  leaving.join();
}

TEST_F(CellSessionTest, AProcessThatIsKilledLeavesTheCellFree) {
  int ready[2];
  ASSERT_EQ(::pipe(ready), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    const auto session = CellSession::open(cell_, "gantry-cell run");
    [[maybe_unused]] const ssize_t told = ::write(ready[1], "x", 1);
    ::pause();
  }
  char byte = 0;
  ASSERT_EQ(::read(ready[0], &byte, 1), 1);
  EXPECT_FALSE(CellSession::open(cell_, "gantry-cell home", 0));
  for (const auto& entry : std::filesystem::directory_iterator(runtime_folder()))
    if (entry.path().extension() == ".lock")
      std::ofstream(std::filesystem::path(entry.path()).replace_extension(".json")) << "old";
  EXPECT_EQ(CellSession::published(cell_), "old");
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  const auto next = CellSession::open(cell_, "gantry-cell home", 1);
  ASSERT_TRUE(next);
  EXPECT_FALSE(CellSession::published(cell_)) << "what the dead one said is no news";
}

TEST_F(CellSessionTest, WhatIsPublishedIsAlwaysWhole) {
  auto session = CellSession::open(cell_, "gantry-cell run");
  ASSERT_TRUE(session);
  EXPECT_FALSE(CellSession::published(cell_));
  std::atomic<int> written{0};
  session->publish([&] {
    ++written;
    return std::string(200'000, static_cast<char>('a' + written % 26));
  });
  while (written < 4) {
    const auto text = CellSession::published(cell_);
    if (!text) continue;
    ASSERT_EQ(text->size(), 200'000u);
    ASSERT_EQ(text->front(), text->back());
  }
}

TEST_F(CellSessionTest, AFolderOfSomebodyElseIsNotTrusted) {
  std::ofstream(folder_ / "gantry") << "a file";
  EXPECT_THROW(runtime_folder(), InputError);
  std::filesystem::remove(folder_ / "gantry");
  std::filesystem::create_directory(folder_ / "elsewhere");
  std::filesystem::create_directory_symlink(folder_ / "elsewhere", folder_ / "gantry");
  EXPECT_THROW(runtime_folder(), InputError) << "a link";
}

}  // namespace
}  // namespace gantry
