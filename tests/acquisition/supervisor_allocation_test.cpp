// The control loop allocates nothing. operator new of this whole test program counts, on the thread and in
// the moments in which a test asks for it.

#include <gtest/gtest.h>

#include <cstdlib>
#include <new>

#include "acquisition/motion_rig.h"

namespace {

thread_local bool g_counting = false;
thread_local int g_allocations = 0;

void* counted(std::size_t size) {
  if (g_counting) ++g_allocations;
  return std::malloc(size == 0 ? 1 : size);
}

}  // namespace

void* operator new(std::size_t size) {
  if (void* memory = counted(size)) return memory;
  throw std::bad_alloc();
}
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  return counted(size);
}
void operator delete(void* memory) noexcept {
  if (g_counting) ++g_allocations;
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  operator delete(memory);
}
void operator delete(void* memory, const std::nothrow_t&) noexcept {
  operator delete(memory);
}

namespace gantry {
namespace {

/// Turns the loop and counts what tick() takes from the heap or gives back.
int allocations_in(MotionRig& rig, int cycles) {
  int total = 0;
  for (int i = 0; i < cycles; ++i) {
    rig.clock.sleep_s(0.01);
    for (auto& axis : rig.axes) axis->channel().service();
    g_allocations = 0;
    g_counting = true;
    rig.supervisor->tick(rig.clock.now_s());
    g_counting = false;
    total += g_allocations;
  }
  return total;
}

int allocations_of(MotionRig& rig, const MotionRequest& request, int cycles) {
  EXPECT_NE(rig.supervisor->request(request), 0u);
  return allocations_in(rig, cycles);
}

TEST(SupervisorAllocates, TheCounterCounts) {
  g_allocations = 0;
  g_counting = true;
  delete new int(1);
  g_counting = false;
  EXPECT_EQ(g_allocations, 2);
}

TEST(SupervisorAllocates, NothingInAnyCycleOfAWorkingDay) {
  MotionRig rig(3);
  MotionRequest request;
  request.axes = 7;
  request.command = AxisTrigger::kEnable;
  EXPECT_EQ(allocations_of(rig, request, 10), 0);
  request.command = AxisTrigger::kHome;
  EXPECT_EQ(allocations_of(rig, request, 2000), 0);
  ASSERT_TRUE(rig.all(AxisState::kStandstill));
  request.command = AxisTrigger::kMove;
  request.moves = MotionRig::to(200, 100, 50);
  EXPECT_EQ(allocations_of(rig, request, 300), 0);
  request.moves = MotionRig::to(200, 100, 5000);
  EXPECT_EQ(allocations_of(rig, request, 5), 0) << "a refusal";
  request.command = AxisTrigger::kJog;
  request.axes = 1;
  request.hold_to_run = true;
  EXPECT_EQ(allocations_of(rig, request, 100), 0) << "the dead-man, too";
  request.command = AxisTrigger::kStop;
  EXPECT_EQ(allocations_of(rig, request, 10), 0);
}

TEST(SupervisorAllocates, NothingInTheCycleThatSeesAFault) {
  const std::function<void(MotionRig&)> faults[] = {
      [](MotionRig& r) { r.drives[1]->silent = true; },
      [](MotionRig& r) { r.world->stage(1).inject(StageFault::kStuck, r.clock.now_s()); },
      [](MotionRig& r) { r.world->stage(1).set_servo(false, r.clock.now_s()); },
      [](MotionRig& r) { r.permit.demanded = StopCategory::kCategory1; },
      [](MotionRig& r) { r.clock.sleep_s(5); },
      [](MotionRig& r) { r.supervisor->stop(true); }};
  for (const auto& begin : faults) {
    MotionRig rig(3);
    rig.home();
    rig.request(AxisTrigger::kMove, 7, MotionRig::to(250, 200, 280));
    rig.steps(40);
    begin(rig);
    EXPECT_EQ(allocations_in(rig, 100), 0);
    MotionRequest reset;
    reset.command = AxisTrigger::kReset;
    EXPECT_EQ(allocations_of(rig, reset, 20), 0);
  }
}

}  // namespace
}  // namespace gantry
