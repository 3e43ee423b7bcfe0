#include "gantry/acquisition/cell_session.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <mutex>
#include <sstream>
#include <thread>
#include <utility>

#include "gantry/foundation/file_hash.h"

namespace gantry {
namespace {

constexpr auto kPublishInterval = std::chrono::milliseconds(200);

std::filesystem::path file_of(const std::filesystem::path& cell_file, const char* suffix) {
  const std::string path = std::filesystem::weakly_canonical(cell_file).string();
  return runtime_folder() / (sha256_of_text(path).substr(0, 16) + suffix);
}

std::string text_of(const std::filesystem::path& path) {
  std::stringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

}  // namespace

std::filesystem::path runtime_folder() {
  const char* offered = std::getenv("XDG_RUNTIME_DIR");
  std::error_code ignored;
  const std::filesystem::path folder =
      offered && *offered && std::filesystem::is_directory(offered, ignored)
          ? std::filesystem::path(offered) / "gantry"
          : std::filesystem::path("/tmp/gantry-" + std::to_string(::geteuid()));
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
    throw InputError(folder.string() + ": cannot be created: " + std::strerror(errno));
  struct stat facts {};
  // Not by way of a link that somebody else has put there.
  if (::lstat(folder.c_str(), &facts) != 0 || !S_ISDIR(facts.st_mode) || facts.st_uid != ::geteuid())
    throw InputError(folder.string() + ": is not a folder of this user; set XDG_RUNTIME_DIR to one");
  return folder;
}

struct CellSession::Publisher {
  Publisher(std::filesystem::path path, std::function<std::string()> make)
      : file(std::move(path)), text(std::move(make)), thread([this] { run(); }) {}
  ~Publisher() {
    {
      std::lock_guard lock(mutex);
      ending = true;
    }
    changed.notify_all();
    thread.join();
    std::error_code ignored;
    std::filesystem::remove(file, ignored);
  }

  void run() {
    const std::filesystem::path half = file.string() + ".new";
    std::unique_lock lock(mutex);
    while (!ending) {
      {
        std::ofstream out(half, std::ios::trunc);
        out << text();
      }
      std::error_code ignored;  // Somebody may have emptied the folder: next time.
      std::filesystem::rename(half, file, ignored);
      changed.wait_for(lock, kPublishInterval, [this] { return ending; });
    }
  }

  const std::filesystem::path file;
  const std::function<std::string()> text;
  std::mutex mutex;
  std::condition_variable changed;
  bool ending = false;
  std::thread thread;
};

CellSession::CellSession(int lock, std::filesystem::path status_file)
    : lock_(lock), status_file_(std::move(status_file)) {}

CellSession::CellSession(CellSession&& other) noexcept
    : lock_(std::exchange(other.lock_, -1)),
      status_file_(std::move(other.status_file_)),
      publisher_(std::move(other.publisher_)) {}

CellSession::~CellSession() {
  publisher_.reset();
  if (lock_ >= 0) ::close(lock_);
}

Result<CellSession> CellSession::open(const std::filesystem::path& cell_file, const std::string& command,
                                      double patience_s) {
  const std::filesystem::path path = file_of(cell_file, ".lock");
  const int lock = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (lock < 0) throw InputError(path.string() + ": cannot be opened: " + std::strerror(errno));
  const auto give_up = std::chrono::steady_clock::now() + std::chrono::duration<double>(patience_s);
  while (::flock(lock, LOCK_EX | LOCK_NB) != 0) {
    if (std::chrono::steady_clock::now() >= give_up) {
      ::close(lock);
      std::string holder = text_of(path);
      if (holder.empty()) holder = "another process";
      return fault(FaultKind::kRefused, "cell " + cell_file.string(),
                   "refused: it is controlled by " + holder + "; stop that first");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  const std::string who = command + " (process " + std::to_string(::getpid()) + ")";
  if (::ftruncate(lock, 0) != 0 ||
      ::pwrite(lock, who.data(), who.size(), 0) != static_cast<ssize_t>(who.size()))
    throw InputError(path.string() + ": cannot be written: " + std::strerror(errno));
  const std::filesystem::path status_file = file_of(cell_file, ".json");
  std::error_code ignored;
  std::filesystem::remove(status_file, ignored);  // Of a holder that was killed.
  return CellSession(lock, status_file);
}

std::optional<std::string> CellSession::published(const std::filesystem::path& cell_file) {
  const std::string text = text_of(file_of(cell_file, ".json"));
  if (text.empty()) return std::nullopt;
  return text;
}

void CellSession::publish(std::function<std::string()> text) {
  publisher_ = std::make_unique<Publisher>(status_file_, std::move(text));
}

}  // namespace gantry
