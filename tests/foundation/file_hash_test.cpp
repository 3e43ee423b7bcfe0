#include "gantry/foundation/file_hash.h"

#include <gtest/gtest.h>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"

namespace gantry {
namespace {

// Vectors of FIPS 180-4, as published by NIST with the secure hash examples.
TEST(FileHash, KnownVectors) {
  const TemporaryFolder folder;
  const auto hash = [&](const std::string& bytes) { return sha256_of_file(folder.write("file", bytes)); };
  EXPECT_EQ(hash(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(hash("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(hash("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  // Longer than the block in which the file is read.
  EXPECT_EQ(hash(std::string(1'000'000, 'a')),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(FileHash, EveryByteCounts) {
  const TemporaryFolder folder;
  std::string bytes(100'000, '\0');
  const std::string whole = sha256_of_file(folder.write("file", bytes));
  for (const size_t i : {size_t{0}, size_t{65'535}, size_t{65'536}, bytes.size() - 1}) {
    std::string changed = bytes;
    changed[i] = 1;
    EXPECT_NE(sha256_of_file(folder.write("file", changed)), whole) << "byte " << i;
  }
  bytes.pop_back();
  EXPECT_NE(sha256_of_file(folder.write("file", bytes)), whole);
}

TEST(FileHash, MissingFileAndDirectoryAreErrors) {
  const TemporaryFolder folder;
  expect_input_error([&] { sha256_of_file(folder / "absent.stl"); }, {"absent.stl"});
  std::filesystem::create_directory(folder / "parts");
  expect_input_error([&] { sha256_of_file(folder / "parts"); }, {"parts"});
}

}  // namespace
}  // namespace gantry
