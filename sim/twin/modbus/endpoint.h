#pragma once

#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

#include "descriptor.h"

namespace gantry {

/// A thread that serves one endpoint of the twin, TCP or serial, and can be told to pull its plug.
class Endpoint {
 public:
  virtual ~Endpoint() = default;
  Endpoint() = default;
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;

  /// Throws InputError when the endpoint cannot be had.
  virtual void start() = 0;
  virtual int port() const { return 0; }
  virtual std::string device() const { return {}; }

  /// Pulled, everybody is disconnected and nobody is let in. Returns when it is so.
  void set_plugged(bool plugged);

 protected:
  /// The wake-up that serve() must poll; call before the thread runs.
  void prepare();
  void run() {
    thread_ = std::thread([this] { serve(); });
  }
  /// Ends serve() and joins; for the destructors of those that implement it.
  void stop();
  int wake_descriptor() const { return wake_.get(); }

  virtual void serve() = 0;

  /// For serve(): what is asked of it. Acknowledged with done().
  struct Wish {
    bool stop, plugged;
  };
  Wish wish();
  void done(bool plugged);

 private:
  void wake();

  Descriptor wake_;
  std::thread thread_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stop_ = false, plugged_wanted_ = true, plugged_ = true, running_ = false;
};

}  // namespace gantry
