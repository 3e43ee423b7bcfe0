// Part of builds with ThreadSanitizer only (preset tsan). Debian's libtbb is not instrumented, so that
// ThreadSanitizer sees neither that a task is handed to another thread before it runs there, nor that a
// parallel_for ends after its last task: it would report a race for nearly every loop, and suppressing
// those (race:tbb::) would hide every real race inside of loops as well. These functions stand in front of
// libtbb's entry points of the same name (oneTBB 2021, SONAME 12), call them, and announce
//   - spawn -> execute: what the spawning thread did before is seen by the task,
//   - the last task -> the end of waiting, by the reference count of the wait_context,
//   - deallocate -> allocate: memory of tasks that another thread uses again.
// To notice where a task is executed they put a table of virtual functions of their own into it, which puts
// the task's own back when it is called; that one is kept meanwhile in a word that libtbb leaves unused.

#include <dlfcn.h>
#include <sanitizer/tsan_interface.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <cstdint>

namespace tbb::detail {
namespace {

using VirtualTable = void**;
constexpr int kExecute = 2, kCancel = 3;  // behind two destructors
constexpr size_t kUnusedWord = 56;        // the last of task::m_reserved
constexpr size_t kReferenceCount = 8;     // wait_context::m_ref_count

VirtualTable& table_of(d1::task& task) {
  return *reinterpret_cast<VirtualTable*>(&task);
}
VirtualTable& kept_table_of(d1::task& task) {
  return *reinterpret_cast<VirtualTable*>(reinterpret_cast<char*>(&task) + kUnusedWord);
}

template <int function>
__attribute__((no_sanitize("thread"))) d1::task* run(d1::task& task, d1::execution_data& data) {
  __tsan_acquire(&task);
  table_of(task) = kept_table_of(task);
  return reinterpret_cast<d1::task* (*)(d1::task&, d1::execution_data&)>(table_of(task)[function])(task,
                                                                                                   data);
}

/// Two words that belong to every virtual table (offset, type), destructors, execute, cancel.
void* g_table[6] = {nullptr,
                    nullptr,
                    nullptr,
                    nullptr,
                    reinterpret_cast<void*>(&run<kExecute>),
                    reinterpret_cast<void*>(&run<kCancel>)};

__attribute__((no_sanitize("thread"))) void announce(d1::task& task) {
  if (table_of(task) != g_table + 2) {
    kept_table_of(task) = table_of(task);
    table_of(task) = g_table + 2;
  }
  __tsan_release(&task);
}

void await_end(d1::wait_context& wait) {
  (void)reinterpret_cast<std::atomic<uint64_t>*>(reinterpret_cast<char*>(&wait) + kReferenceCount)
      ->load(std::memory_order_acquire);
}

/// libtbb's own function, by its mangled name.
template <typename Function>
Function real(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

}  // namespace

namespace r1 {

void spawn(d1::task& task, d1::task_group_context& context) {
  static const auto next = real<void (*)(d1::task&, d1::task_group_context&)>(
      "_ZN3tbb6detail2r15spawnERNS0_2d14taskERNS2_18task_group_contextE");
  announce(task);
  next(task, context);
}

void spawn(d1::task& task, d1::task_group_context& context, d1::slot_id slot) {
  static const auto next = real<void (*)(d1::task&, d1::task_group_context&, d1::slot_id)>(
      "_ZN3tbb6detail2r15spawnERNS0_2d14taskERNS2_18task_group_contextEt");
  announce(task);
  next(task, context, slot);
}

void execute_and_wait(d1::task& task, d1::task_group_context& context, d1::wait_context& wait,
                      d1::task_group_context& wait_group) {
  static const auto next = real<decltype(&execute_and_wait)>(
      "_ZN3tbb6detail2r116execute_and_waitERNS0_2d14taskERNS2_18task_group_contextERNS2_12wait_contextES6_");
  announce(task);
  next(task, context, wait, wait_group);
  await_end(wait);
}

void wait(d1::wait_context& context, d1::task_group_context& group) {
  static const auto next = real<void (*)(d1::wait_context&, d1::task_group_context&)>(
      "_ZN3tbb6detail2r14waitERNS0_2d112wait_contextERNS2_18task_group_contextE");
  next(context, group);
  await_end(context);
}

void* allocate(d1::small_object_pool*& pool, std::size_t size, const d1::execution_data& data) {
  static const auto next = real<void* (*)(d1::small_object_pool*&, std::size_t, const d1::execution_data&)>(
      "_ZN3tbb6detail2r18allocateERPNS0_2d117small_object_poolEmRKNS2_14execution_dataE");
  void* memory = next(pool, size, data);
  __tsan_acquire(memory);
  return memory;
}

void* allocate(d1::small_object_pool*& pool, std::size_t size) {
  static const auto next = real<void* (*)(d1::small_object_pool*&, std::size_t)>(
      "_ZN3tbb6detail2r18allocateERPNS0_2d117small_object_poolEm");
  void* memory = next(pool, size);
  __tsan_acquire(memory);
  return memory;
}

void deallocate(d1::small_object_pool& pool, void* memory, std::size_t size, const d1::execution_data& data) {
  static const auto next =
      real<void (*)(d1::small_object_pool&, void*, std::size_t, const d1::execution_data&)>(
          "_ZN3tbb6detail2r110deallocateERNS0_2d117small_object_poolEPvmRKNS2_14execution_dataE");
  __tsan_release(memory);
  next(pool, memory, size, data);
}

void deallocate(d1::small_object_pool& pool, void* memory, std::size_t size) {
  static const auto next = real<void (*)(d1::small_object_pool&, void*, std::size_t)>(
      "_ZN3tbb6detail2r110deallocateERNS0_2d117small_object_poolEPvm");
  __tsan_release(memory);
  next(pool, memory, size);
}

}  // namespace r1
}  // namespace tbb::detail
