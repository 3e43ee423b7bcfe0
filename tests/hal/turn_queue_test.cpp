#include "modbus/turn_queue.h"

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace gantry {
namespace {

/// Callers that queue while the turn is held, in a known order; then who is served when.
class Line {
 public:
  Line() : held_(new TurnQueue::Turn(queue_.take(99, false))) {}
  ~Line() {
    for (auto& thread : threads_) thread.join();
  }

  void queue(const std::string& name, int unit, bool urgent = false) {
    const size_t before = queue_.waiting();
    threads_.emplace_back([this, name, unit, urgent] {
      const auto turn = queue_.take(unit, urgent);
      served_ += name;
    });
    while (queue_.waiting() == before) std::this_thread::sleep_for(std::chrono::microseconds(100));
  }

  std::string serve_all() {
    held_.reset();
    for (auto& thread : threads_) thread.join();
    threads_.clear();
    return served_;
  }

 private:
  TurnQueue queue_;
  std::unique_ptr<TurnQueue::Turn> held_;
  std::vector<std::thread> threads_;
  std::string served_;  ///< Only by who has the turn.
};

TEST(TurnQueue, OneUnitIsServedInItsOrder) {
  Line line;
  for (const char* name : {"a", "b", "c", "d"}) line.queue(name, 1);
  EXPECT_EQ(line.serve_all(), "abcd");
}

TEST(TurnQueue, AUnitThatAsksMuchDoesNotStarveTheOthers) {
  Line line;
  for (const char* name : {"a", "b", "c", "d"}) line.queue(name, 1);
  line.queue("X", 2);
  line.queue("Y", 2);
  line.queue("P", 3);
  EXPECT_EQ(line.serve_all(), "aXPbYcd");
}

TEST(TurnQueue, AHaltOvertakesEverybody) {
  Line line;
  for (const char* name : {"a", "b"}) line.queue(name, 1);
  line.queue("X", 2);
  line.queue("!", 2, true);
  line.queue("?", 1, true);
  // Then in turn again: unit 2 was served before unit 1.
  EXPECT_EQ(line.serve_all(), "!?Xab");
}

TEST(TurnQueue, OnlyOneHasTheTurn) {
  TurnQueue queue;
  int inside = 0, most = 0, done = 0;
  std::vector<std::thread> threads;
  for (int unit = 0; unit < 8; ++unit)
    threads.emplace_back([&, unit] {
      for (int i = 0; i < 500; ++i) {
        const auto turn = queue.take(unit % 4, i % 7 == 0);
        most = std::max(most, ++inside);
        ++done;
        --inside;
      }
    });
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(most, 1);
  EXPECT_EQ(done, 8 * 500);
}

}  // namespace
}  // namespace gantry
