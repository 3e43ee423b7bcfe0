#pragma once

#include <random>
#include <string>
#include <vector>

namespace gantry::fuzz {

/// Makes bad inputs of good ones: flipped bits, cuts, splices, lines and words that move, are doubled or
/// vanish, and numbers, in text and in binary, that are huge, negative, or none at all.
class Mutator {
 public:
  explicit Mutator(std::vector<std::string> seeds);

  /// The input of this number: depends on the seeds, `seed` and `number` alone.
  std::string input(uint64_t seed, uint64_t number) const;

 private:
  std::vector<std::string> seeds_;
  std::vector<std::string> words_;  ///< All words of the seeds that are text.
};

}  // namespace gantry::fuzz
