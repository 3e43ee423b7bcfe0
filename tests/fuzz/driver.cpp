// The main program of a fuzz target:
//   NAME_fuzz [--runs N] [--seconds S] [--seed K] [--first I]   inputs I, I + 1, ... of seed K, without end
//   NAME_fuzz FILE...                                         these inputs
// The good inputs themselves come first. Ends with exit code 1 (or with a sanitizer's) at the first input
// on which the target crashes, lets an exception out, computes longer than kMostSeconds, or asks for more
// memory at once than most_bytes() allows; that input is then in NAME_fuzz.failed in the working folder.

#include <sys/time.h>
#include <unistd.h>

#include <cxxabi.h>
#include <fcntl.h>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <limits>
#include <new>

#include "fuzz.h"
#include "mutation.h"

extern "C" void __sanitizer_set_death_callback(void (*)()) __attribute__((weak));
extern "C" void __sanitizer_print_stack_trace() __attribute__((weak));

namespace {

constexpr int kMostSeconds = 10;  ///< Of processor time; sanitizers make everything several times slower.

/// What one allocation may take for an input of this size: no header can claim more than its file holds.
constexpr size_t most_bytes(size_t input_size) {
  return (size_t{16} << 20) + 64 * input_size;
}

std::string g_failed_file;
std::string g_input;
uint64_t g_number = 0;
std::atomic<bool> g_running = false;

/// Runs in signal handlers and within malloc, so nothing here allocates.
void keep_input() {
  if (!g_running.exchange(false)) return;
  const int file = ::open(g_failed_file.c_str(), O_CREAT | O_TRUNC | O_WRONLY, 0644);
  [[maybe_unused]] const auto written = ::write(file, g_input.data(), g_input.size());
  ::close(file);
  std::fprintf(stderr, "FAILED: input %lu, %zu bytes, kept in %s\n", static_cast<unsigned long>(g_number),
               g_input.size(), g_failed_file.c_str());
}

[[noreturn]] void fail(const char* what, const char* detail = "") {
  std::fprintf(stderr, "%s%s\n", what, detail);
  keep_input();
  if (__sanitizer_print_stack_trace) __sanitizer_print_stack_trace();
  std::_Exit(1);
}

void on_signal(int signal) {
  if (signal == SIGPROF) std::fprintf(stderr, "no end after %d s of computing\n", kMostSeconds);
  keep_input();
  std::signal(signal, SIG_DFL);
  if (signal == SIGPROF) std::abort();
  std::raise(signal);
}

void* allocate(size_t size) {
  if (g_running.load(std::memory_order_relaxed) && size > most_bytes(g_input.size())) {
    char text[80];
    std::snprintf(text, sizeof text, "%zu bytes for an input of %zu bytes", size, g_input.size());
    fail("allocation too large: ", text);
  }
  if (void* memory = std::malloc(size == 0 ? 1 : size)) return memory;
  throw std::bad_alloc();
}

void run_one() {
  const itimerval limit{{}, {kMostSeconds, 0}};
  ::setitimer(ITIMER_PROF, &limit, nullptr);
  g_running = true;
  try {
    LLVMFuzzerTestOneInput(reinterpret_cast<const uint8_t*>(g_input.data()), g_input.size());
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s: ", abi::__cxa_current_exception_type()->name());
    fail("not an InputError: ", e.what());
  } catch (...) {
    fail("not an InputError");
  }
  g_running = false;
}

uint64_t number_of(const char* text) {
  return std::strtoull(text, nullptr, 10);
}

}  // namespace

void* operator new(size_t size) {
  return allocate(size);
}
// std::stable_sort asks for its buffer by this one.
void* operator new(size_t size, const std::nothrow_t&) noexcept {
  return std::malloc(size);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, size_t) noexcept {
  std::free(memory);
}

int main(int argc, char** argv) {
  uint64_t runs = std::numeric_limits<uint64_t>::max(), seed = 1, first = 0;
  double seconds = std::numeric_limits<double>::infinity();
  std::vector<std::string> files;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument.rfind("--", 0) != 0 || i + 1 == argc) {
      files.push_back(argument);
    } else if (argument == "--runs") {
      runs = number_of(argv[++i]);
    } else if (argument == "--seconds") {
      seconds = std::strtod(argv[++i], nullptr);
    } else if (argument == "--seed") {
      seed = number_of(argv[++i]);
    } else if (argument == "--first") {
      first = number_of(argv[++i]);
    }
  }
  g_failed_file = std::filesystem::path(argv[0]).filename().string() + ".failed";
  for (const int signal : {SIGABRT, SIGPROF}) std::signal(signal, on_signal);
  if (__sanitizer_set_death_callback) {
    __sanitizer_set_death_callback(keep_input);
  } else {
    for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL}) std::signal(signal, on_signal);
  }

  for (const std::string& file : files) {
    g_input = gantry::TemporaryFolder::read(file);
    run_one();
  }
  if (!files.empty()) return 0;

  const gantry::fuzz::Mutator mutator(gantry::fuzz::seeds());
  const auto start = std::chrono::steady_clock::now();
  const auto elapsed_s = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  uint64_t done = 0;
  for (; done < runs && elapsed_s() < seconds; ++done) {
    g_number = first + done;
    g_input = mutator.input(seed, g_number);
    run_one();
  }
  std::printf("%lu inputs in %.1f s, seed %lu\n", static_cast<unsigned long>(done), elapsed_s(),
              static_cast<unsigned long>(seed));
}
