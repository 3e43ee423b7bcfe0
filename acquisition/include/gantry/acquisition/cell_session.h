#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "gantry/foundation/error.h"

namespace gantry {

/// Where the processes of one user find each other: $XDG_RUNTIME_DIR/gantry, or /tmp/gantry-UID. Created
/// where it is missing, for the user alone. Throws InputError when it cannot be had or belongs to another.
std::filesystem::path runtime_folder();

/// The one process that controls a cell. Held as a lock (flock) on a file in the runtime folder, named after
/// the hash of the cell file's path, so that it ends with the process, however that ends. Beside it the
/// holder may publish what it sees, for `gantry-cell status` of another process.
class CellSession {
 public:
  /// kRefused naming the holder when another process has the cell; waits for it for `patience_s` (status
  /// holds a cell for a moment only). Throws InputError when the runtime folder cannot be used.
  static Result<CellSession> open(const std::filesystem::path& cell_file, const std::string& command,
                                  double patience_s = 2.0);
  /// What the holder published last; nothing when it has not yet.
  static std::optional<std::string> published(const std::filesystem::path& cell_file);

  CellSession(CellSession&& other) noexcept;
  CellSession& operator=(CellSession&&) = delete;
  ~CellSession();

  /// From now on writes `text()` five times a second, each time as a whole (write, then rename), from a
  /// thread of its own.
  void publish(std::function<std::string()> text);

 private:
  struct Publisher;
  CellSession(int lock, std::filesystem::path status_file);

  int lock_ = -1;
  std::filesystem::path status_file_;
  std::unique_ptr<Publisher> publisher_;
};

}  // namespace gantry
