#pragma once

#include <pthread.h>

namespace gantry {

/// A mutex between a real-time thread and others: who holds it runs with the priority of whoever waits
/// for it (PTHREAD_PRIO_INHERIT), so that a thread of middling priority cannot keep the loop waiting.
/// Hold it for the time of a copy, never across I/O. Use with std::lock_guard.
class RealTimeMutex {
 public:
  RealTimeMutex() {
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
    pthread_mutex_init(&mutex_, &attributes);
    pthread_mutexattr_destroy(&attributes);
  }
  ~RealTimeMutex() { pthread_mutex_destroy(&mutex_); }
  RealTimeMutex(const RealTimeMutex&) = delete;
  RealTimeMutex& operator=(const RealTimeMutex&) = delete;

  void lock() { pthread_mutex_lock(&mutex_); }
  void unlock() { pthread_mutex_unlock(&mutex_); }

 private:
  pthread_mutex_t mutex_;
};

}  // namespace gantry
