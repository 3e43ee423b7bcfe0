// Takes the place of step_file.cpp in a build without OpenCASCADE.

#include "gantry/foundation/error.h"
#include "step_file.h"

namespace gantry {
namespace internal {

TriangleMesh read_step(const std::filesystem::path& path, const TessellationOptions&, std::string&) {
  throw InputError(
      path.string() +
      ": this build reads no STEP: install libocct-data-exchange-dev and build again, or export the "
      "part as STL");
}

}  // namespace internal

std::string step_support() {
  return "not read; install libocct-data-exchange-dev and build again";
}
bool reads_step() {
  return false;
}

}  // namespace gantry
