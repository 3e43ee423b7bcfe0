// The safety chain and its permit allocate nothing in a cycle. operator new of this whole program counts, on
// the thread and in the moments in which a test asks for it.

#include <gtest/gtest.h>

#include <cstdlib>
#include <new>

#include "gantry/acquisition/safety_permit.h"
#include "gantry/sim/safety_contacts.h"

namespace {

thread_local bool g_counting = false;
thread_local int g_allocations = 0;

}  // namespace

// Not inlined: g++ takes new and free for a mismatch where it sees both at once.
[[gnu::noinline]] void* operator new(std::size_t size) {
  if (g_counting) ++g_allocations;
  if (void* memory = std::malloc(size == 0 ? 1 : size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept {
  if (g_counting) ++g_allocations;
  std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept {
  operator delete(memory);
}

namespace gantry {
namespace {

template <typename Action>
int allocations_of(Action action) {
  g_allocations = 0;
  g_counting = true;
  action();
  g_counting = false;
  return g_allocations;
}

SafetySettings settings() {
  SafetySettings result;
  result.inputs = {{"emergency stop", {0, 1}, StopCategory::kCategory0, 0.1, 0.05},
                   {"door", {2, 3}, StopCategory::kCategory1, 0.5, 0.1},
                   {"light curtain", {4}, StopCategory::kCategory1, 0.1, 0.05}};
  return result;
}

TEST(SafetyAllocations, TheCounterCounts) {
  EXPECT_GE(allocations_of([] { std::string(100, 'x').swap(*std::make_unique<std::string>()); }), 2);
}

TEST(SafetyAllocations, TheChainAllocatesNothingWhateverItIsGiven) {
  SafetyChain chain(settings());
  SafetyInputsSnapshot snapshot;
  int moving = 0;
  const int allocations = allocations_of([&] {
    for (int k = 0; k < 3000; ++k) {
      snapshot.valid = k % 97 != 0;
      snapshot.count = k % 101 == 0 ? 4 : 5;
      snapshot.sampled_at_s = 0.01 * k;
      for (size_t c = 0; c < 5; ++c) snapshot.closed[c] = (static_cast<size_t>(k) / 80 + c / 2) % 5 != 0;
      if (k > 2500) snapshot.closed[1] = true;  // in the end a channel is stuck
      moving += chain.update(snapshot, k % 3 == 0, 0.01 * k).motion_allowed;
    }
  });
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(moving, 100) << "it is not latched all the time";
}

TEST(SafetyAllocations, ThePermitAllocatesNothing) {
  VirtualClock clock;
  SafetyContacts contacts({{"emergency stop", {0, 1}}, {"door", {2, 3}}, {"light curtain", {4}}}, clock);
  auto channel =
      std::make_shared<SafetyInputsChannel>(make_simulated_safety_inputs(contacts, {0, 1, 2, 3, 4}), clock);
  SafetyPermit permit(settings(), channel);
  int allocations = 0, moving = 0;
  for (int k = 0; k < 1000; ++k) {
    clock.sleep_s(0.01);
    if (k == 500) contacts.press("door");
    if (k == 600) contacts.release("door");
    if (k % 100 < 80) channel->service();
    StopCategory stop = StopCategory::kNone;
    allocations += allocations_of([&] { stop = permit.required_stop(clock.now_s(), k % 50 == 0); });
    moving += stop == StopCategory::kNone;
  }
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(moving, 100);
}

}  // namespace
}  // namespace gantry
