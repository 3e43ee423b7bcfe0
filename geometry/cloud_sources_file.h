#pragma once

#include <cstdint>
#include <filesystem>
#include <iosfwd>
#include <memory>
#include <string>
#include <vector>

#include "gantry/geometry/cloud_sources.h"

/// CloudSources in a PLY file, where programs that know nothing of them read past:
///
///   comment gantry scan NAME                 one line for each scan
///   comment gantry doubt REASON              where there is one
///   property ushort scans                    of a vertex: by how many scans it was measured
///   element scan_share N                     of vertex after vertex
///   property ushort scan                     which, from 0 in the order of the comments
///   property ushort parts                    of 65535
///   element pose_covariance 36 n n           row by row, in the file's unit
///   property double number

namespace gantry::internal {

/// As they stand in the file.
struct RawSources {
  std::vector<std::string> scans;
  std::string doubt;
  std::vector<CloudSources::Share> shares;
  std::vector<double> pose_covariance;
};

/// Null when the file has none. `counts`: scans of each vertex, those with used[i] = 0 dropped here as well.
/// Throws InputError naming the file when the numbers do not fit each other.
std::shared_ptr<const CloudSources> sources_of(const RawSources& raw, const std::vector<double>& counts,
                                               const std::vector<char>& used, double unit_mm,
                                               const std::filesystem::path& path);

void write_sources_comments(std::ostream& header, const CloudSources& sources);
void write_sources_elements(std::ostream& header, const CloudSources& sources);
void write_sources_body(std::ostream& body, const CloudSources& sources);

}  // namespace gantry::internal
