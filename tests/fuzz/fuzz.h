#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "foundation/temporary_folder.h"
#include "gantry/foundation/error.h"

// A fuzz target is one file NAME_fuzz.cpp that defines the two functions below; driver.cpp has the main
// program. The entry point is libFuzzer's, so that a target links with that too
// (clang++ -fsanitize=fuzzer, without driver.cpp).

/// Hands one input to the code under test. It must come back, and let no exception out: whatever the
/// bytes are, the code under test gives a value, an InputError or a Fault.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace gantry::fuzz {

/// Good inputs, made by the program's own writers where it has them: what the mutations start from.
std::vector<std::string> seeds();

/// Runs `parse`, which may end in an InputError; the driver reports any other exception.
template <class Parse>
void value_or_input_error(Parse&& parse) {
  try {
    parse();
  } catch (const InputError&) {
  }
}

/// A file of the given name in a folder of its own, written anew for every input.
class InputFile {
 public:
  explicit InputFile(const std::string& name) : path_(folder_ / name) {}

  const std::filesystem::path& write(const std::string& bytes) const {
    std::ofstream(path_, std::ios::binary | std::ios::trunc)
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    return path_;
  }

 private:
  TemporaryFolder folder_;
  std::filesystem::path path_;
};

inline std::string text_of(const uint8_t* data, size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

}  // namespace gantry::fuzz
