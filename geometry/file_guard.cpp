#include "file_guard.h"

#include <fcntl.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <cstring>

#include "gantry/foundation/error.h"

namespace gantry::internal {

void require_file(const std::filesystem::path& path) {
  std::error_code error;  // a folder on the way may be closed to us: that is no such file too
  if (!std::filesystem::is_regular_file(path, error))
    throw InputError(path.string() +
                     (std::filesystem::exists(path, error) ? ": a file is expected" : ": no such file"));
  if (::faccessat(AT_FDCWD, path.c_str(), R_OK, AT_EACCESS) != 0)
    throw InputError(path.string() + ": cannot be read: " + std::strerror(errno));
}

std::string lower_extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

void publish(const std::filesystem::path& partial, const std::filesystem::path& path) {
  const auto sync = [](const std::filesystem::path& what) {
    const int fd = ::open(what.c_str(), O_RDONLY);
    const bool ok = fd >= 0 && ::fsync(fd) == 0;
    const int error = errno;
    if (fd >= 0) ::close(fd);
    if (!ok) throw InputError(what.string() + ": cannot be synced to disk: " + std::strerror(error));
  };
  sync(partial);
  std::error_code error;
  std::filesystem::rename(partial, path, error);
  if (error) throw InputError(path.string() + ": cannot be written: " + error.message());
  sync(path.has_parent_path() ? path.parent_path() : std::filesystem::path("."));
}

}  // namespace gantry::internal
