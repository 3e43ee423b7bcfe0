#include "gantry/acquisition/scan_queue.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

namespace gantry {
namespace {

TaggedScan named(int i) {
  return {std::to_string(i), {}, {}};
}

/// Polls until `condition` holds; false after ten seconds.
template <typename Condition>
bool eventually(const Condition& condition) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::yield();
  }
  return true;
}

TEST(ScanQueue, HandsOnEveryScanInOrderAndIsNeverAheadByMoreThanItsCapacity) {
  constexpr int kScans = 500, kCapacity = 3;
  ScanQueue queue(kCapacity);
  std::atomic<int> pushed = 0, popping = 0;
  std::thread producer([&] {
    for (int i = 0; i < kScans; ++i) {
      EXPECT_TRUE(queue.push(named(i)));
      ++pushed;
    }
    queue.close();
  });
  EXPECT_TRUE(eventually([&] { return pushed >= kCapacity; }));
  for (int i = 0;; ++i) {
    for (int k = 0; k < 20; ++k) {
      EXPECT_LE(pushed - popping, kCapacity);
      std::this_thread::yield();
    }
    ++popping;
    const auto scan = queue.pop();
    if (!scan) {
      EXPECT_EQ(i, kScans);
      break;
    }
    ASSERT_EQ(scan->name, std::to_string(i));
  }
  producer.join();
}

TEST(ScanQueue, CloseWakesWhoWaitsToPush) {
  ScanQueue queue(1);
  ASSERT_TRUE(queue.push(named(0)));
  std::atomic<int> outcome = -1;
  std::thread producer([&] { outcome = queue.push(named(1)); });
  queue.close();
  EXPECT_TRUE(eventually([&] { return outcome >= 0; }));
  EXPECT_EQ(outcome, 0) << "nobody will read this scan";
  producer.join();
  EXPECT_FALSE(queue.push(named(2)));
  EXPECT_EQ(queue.pop()->name, "0") << "what was pushed before is still read";
  EXPECT_FALSE(queue.pop());
}

TEST(ScanQueue, CloseWakesWhoWaitsToPop) {
  ScanQueue queue(1);
  std::atomic<bool> ended = false;
  std::thread consumer([&] {
    EXPECT_FALSE(queue.pop());
    ended = true;
  });
  queue.close();
  EXPECT_TRUE(eventually([&] { return ended.load(); }));
  consumer.join();
}

}  // namespace
}  // namespace gantry
