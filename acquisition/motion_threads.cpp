#include "gantry/acquisition/motion_threads.h"

#include <pthread.h>
#include <semaphore.h>
#include <time.h>

#include <map>

namespace gantry {
namespace {

constexpr int kLoopPriority = 60;
constexpr int kIoPriority = 55;  ///< The loop comes first.
/// A drive is read at least so often; a command wakes its thread at once.
constexpr double kReadInterval_s = 0.005;

}  // namespace

class MotionThreads::IoThread final : public Waker {
 public:
  explicit IoThread(Clock& clock) : clock_(clock) { sem_init(&wake_, 0, 0); }
  ~IoThread() override {
    ending_ = true;
    wake();
    if (thread_.joinable()) thread_.join();
    sem_destroy(&wake_);
  }

  void add(DriveChannel& channel, const LoopHeartbeat& loop, double stall_limit_s) {
    channels_.push_back(&channel);
    channel.watch(&loop, stall_limit_s, this);
  }
  void add(std::function<void()> service) { services_.push_back(std::move(service)); }
  void start() {
    thread_ = std::thread([this] { run(); });
  }
  void wake() override { sem_post(&wake_); }
  void forget_loop() {
    for (DriveChannel* channel : channels_) channel->watch(nullptr, 0, this);
  }
  void release_channels() {
    for (DriveChannel* channel : channels_) channel->watch(nullptr, 0, nullptr);
  }

 private:
  void run() {
    pthread_setname_np(pthread_self(), "gantry-io");
    (void)become_real_time(kIoPriority);
    while (!ending_) {
      const double begin_s = clock_.now_s();
      for (const auto& service : services_) service();
      for (DriveChannel* channel : channels_) channel->service();
      sleep_until(begin_s + kReadInterval_s);
    }
    for (DriveChannel* channel : channels_) channel->service();
  }

  // Until then, or until a command comes.
  void sleep_until(double due_s) {
    const double remaining_s = due_s - clock_.now_s();
    if (remaining_s <= 0) return;
    timespec due{};
    clock_gettime(CLOCK_MONOTONIC, &due);
    due.tv_nsec += static_cast<long>(remaining_s * 1e9);
    due.tv_sec += due.tv_nsec / 1'000'000'000;
    due.tv_nsec %= 1'000'000'000;
    sem_clockwait(&wake_, CLOCK_MONOTONIC, &due);
  }

  Clock& clock_;
  std::vector<DriveChannel*> channels_;
  std::vector<std::function<void()>> services_;
  sem_t wake_;
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

MotionThreads::MotionThreads(Supervisor& supervisor, const std::vector<size_t>& bus_of_axis,
                             const std::vector<IoService>& services, Clock& clock)
    : supervisor_(supervisor) {
  supervisor.tick(clock.now_s());  // The loop counts as alive from now on.
  std::map<size_t, IoThread*> of_bus;
  const auto thread_of = [&](size_t bus) -> IoThread& {
    IoThread*& io = of_bus[bus];
    if (!io) {
      io_.push_back(std::make_unique<IoThread>(clock));
      io = io_.back().get();
    }
    return *io;
  };
  for (const IoService& other : services) thread_of(other.bus).add(other.service);
  for (size_t i = 0; i < supervisor.axes().size(); ++i) {
    thread_of(bus_of_axis[i])
        .add(supervisor.axes()[i]->channel(), supervisor.heartbeat(), supervisor.settings().stall_limit_s);
  }
  for (auto& io : io_) io->start();
  loop_ = std::make_unique<RealTimeLoop>(supervisor.settings().period_s, kLoopPriority,
                                         [this, &clock] { supervisor_.tick(clock.now_s()); });
}

MotionThreads::~MotionThreads() {
  for (auto& io : io_) io->forget_loop();
  loop_.reset();
  for (auto& io : io_) io->release_channels();
  io_.clear();
}

}  // namespace gantry
