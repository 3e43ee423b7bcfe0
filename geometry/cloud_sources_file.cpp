#include "cloud_sources_file.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ostream>

#include "gantry/foundation/error.h"

namespace gantry::internal {
namespace {

constexpr double kRounding = 1e-6;  ///< Relative; what other programs do to symmetry in writing.

[[noreturn]] void fail(const std::filesystem::path& path, const std::string& message) {
  throw InputError(path.string() + ": " + message);
}

/// The covariance in mm. It has to be symmetric, with no negative variance.
Eigen::MatrixXd covariance_of(const RawSources& raw, double unit_mm, const std::filesystem::path& path) {
  const auto n = static_cast<Eigen::Index>(6 * raw.scans.size());
  if (raw.pose_covariance.empty()) return {};
  if (raw.pose_covariance.size() != static_cast<size_t>(n * n))
    fail(path, "pose_covariance has " + std::to_string(raw.pose_covariance.size()) + " numbers; expected " +
                   std::to_string(n * n) + " for " + std::to_string(raw.scans.size()) + " scans");
  Eigen::MatrixXd covariance(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j) {
      const double value = raw.pose_covariance[static_cast<size_t>(i * n + j)];
      if (!std::isfinite(value)) fail(path, "pose_covariance holds a number that is not finite");
      covariance(i, j) = value * (i % 6 < 3 ? 1 : unit_mm) * (j % 6 < 3 ? 1 : unit_mm);
    }
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j)
      if (covariance(i, i) < 0 || std::abs(covariance(i, j) - covariance(j, i)) >
                                      kRounding * std::sqrt(covariance(i, i) * covariance(j, j)))
        fail(path,
             "pose_covariance is no covariance: row " + std::to_string(i) + ", column " + std::to_string(j));
  return covariance;
}

}  // namespace

std::shared_ptr<const CloudSources> sources_of(const RawSources& raw, const std::vector<double>& counts,
                                               const std::vector<char>& used, double unit_mm,
                                               const std::filesystem::path& path) {
  if (raw.shares.empty()) return nullptr;
  auto sources = std::make_shared<CloudSources>();
  sources->scans = raw.scans;
  sources->doubt = raw.doubt;
  sources->pose_covariance = covariance_of(raw, unit_mm, path);
  sources->first.push_back(0);
  size_t at = 0;
  for (size_t i = 0; i < used.size(); ++i) {
    const double count = i < counts.size() ? counts[i] : 0;
    if (!(count >= 1) || count != std::floor(count) || count > static_cast<double>(raw.shares.size() - at))
      fail(path, "vertex " + std::to_string(i) + " claims " + std::to_string(count) +
                     " scans; expected a whole number, at least 1, that element 'scan_share' has room for");
    double parts = 0;
    for (const size_t end = at + static_cast<size_t>(count); at < end; ++at) {
      const CloudSources::Share& share = raw.shares[at];
      if (share.scan >= raw.scans.size())
        fail(path, "scan_share " + std::to_string(at) + " refers to scan " + std::to_string(share.scan) +
                       ", of which there is no 'comment gantry scan'");
      parts += share.parts;
      if (used[i]) sources->shares.push_back(share);
    }
    if (std::abs(parts - CloudSources::Share::kWhole) > count)
      fail(path, "the shares of vertex " + std::to_string(i) + " sum up to " +
                     std::to_string(parts / CloudSources::Share::kWhole) + "; expected 1");
    if (used[i]) sources->first.push_back(static_cast<uint32_t>(sources->shares.size()));
  }
  if (at != raw.shares.size())
    fail(path, "element 'scan_share' has " + std::to_string(raw.shares.size()) +
                   " entries, but vertices claim " + std::to_string(at));
  return sources;
}

void write_sources_comments(std::ostream& header, const CloudSources& sources) {
  for (const std::string& name : sources.scans) header << "comment gantry scan " << name << "\n";
  std::string line = sources.doubt;
  std::replace(line.begin(), line.end(), '\n', ' ');
  if (!line.empty()) header << "comment gantry doubt " << line << "\n";
}

void write_sources_elements(std::ostream& header, const CloudSources& sources) {
  header << "element scan_share " << sources.shares.size()
         << "\nproperty ushort scan\nproperty ushort parts\n";
  if (sources.pose_covariance.size() > 0)
    header << "element pose_covariance " << sources.pose_covariance.size() << "\nproperty double number\n";
}

void write_sources_body(std::ostream& body, const CloudSources& sources) {
  static_assert(sizeof(CloudSources::Share) == 4);
  body.write(reinterpret_cast<const char*>(sources.shares.data()),
             static_cast<std::streamsize>(sources.shares.size() * sizeof(CloudSources::Share)));
  // Symmetric: column by column is row by row.
  body.write(reinterpret_cast<const char*>(sources.pose_covariance.data()),
             sources.pose_covariance.size() * static_cast<std::streamsize>(sizeof(double)));
}

}  // namespace gantry::internal
