#include "mutation.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>
#include <set>

namespace gantry::fuzz {
namespace {

constexpr size_t kLongestInput = 1 << 16;

constexpr std::array kNumbers = {"0",
                                 "-1",
                                 "1",
                                 "-0.0",
                                 "255",
                                 "256",
                                 "65535",
                                 "65536",
                                 "2147483647",
                                 "2147483648",
                                 "-2147483648",
                                 "4294967295",
                                 "4294967296",
                                 "9223372036854775807",
                                 "18446744073709551616",
                                 "1e9",
                                 "1e38",
                                 "1e39",
                                 "1e308",
                                 "1e999",
                                 "-1e999",
                                 "1e-320",
                                 "nan",
                                 "-nan",
                                 "inf",
                                 "-inf",
                                 ".",
                                 "1e",
                                 "0x7fffffff",
                                 "1,5",
                                 "99999999999999999999999999"};

constexpr std::array<uint64_t, 12> kBinaryNumbers = {0,          1,          0x7f,       0xff,
                                                     0x7fff,     0xffff,     0x7fffffff, 0x80000000,
                                                     0xffffffff, 0x7f800000, 0x7fc00000, 0xffffffffffffffff};

/// One input in the making.
class Work {
 public:
  Work(std::string bytes, std::mt19937_64& random) : bytes_(std::move(bytes)), random_(random) {}

  void mutate(const std::vector<std::string>& seeds, const std::vector<std::string>& words) {
    switch (below(14)) {
      case 0:
        return flip_bit();
      case 1:
        return put_byte();
      case 2:
        return cut_range();
      case 3:
        return double_range();
      case 4:
        return bytes_.resize(below(bytes_.size() + 1));
      case 5:
        return splice(seeds[below(seeds.size())]);
      case 6:
      case 7:
        return put_number();
      case 8:
      case 9:
        return put_binary_number();
      case 10:
        return insert(words.empty() ? " " : words[below(words.size())] + (below(2) ? " " : "\n"));
      case 11:
        return replace_word(words.empty() ? "x" : words[below(words.size())]);
      default:
        return move_line();
    }
  }

  std::string take() {
    if (bytes_.size() > kLongestInput) bytes_.resize(kLongestInput);
    return std::move(bytes_);
  }

 private:
  size_t below(size_t n) { return n == 0 ? 0 : random_() % n; }
  /// Near the beginning more often than its length gives it: that is where headers are.
  size_t place() { return below(below(2) ? bytes_.size() : std::min<size_t>(bytes_.size(), 400)); }

  void flip_bit() {
    if (!bytes_.empty()) bytes_[place()] ^= static_cast<char>(1 << below(8));
  }
  void put_byte() {
    if (!bytes_.empty()) bytes_[place()] = static_cast<char>(below(256));
  }
  void cut_range() {
    const size_t at = place();
    bytes_.erase(at, 1 + below(below(2) ? 8 : bytes_.size()));
  }
  void double_range() {
    const size_t at = place();
    bytes_.insert(at, bytes_.substr(at, 1 + below(64)));
  }
  void splice(const std::string& other) {
    const size_t begin = below(other.size() + 1);
    bytes_ = bytes_.substr(0, below(bytes_.size() + 1)) + other.substr(begin);
  }
  void insert(const std::string& text) { bytes_.insert(place(), text); }

  /// In place of one that stands there, as the largest run of digits from a random place on.
  void put_number() {
    const std::string number = kNumbers[below(kNumbers.size())];
    const auto part_of_number = [](char c) {
      return std::isdigit(static_cast<unsigned char>(c)) || c == '.' || c == '-';
    };
    const auto begin =
        std::find_if(bytes_.begin() + static_cast<std::ptrdiff_t>(place()), bytes_.end(), part_of_number);
    const auto end = std::find_if_not(begin, bytes_.end(), part_of_number);
    bytes_.replace(begin, end, number);
  }
  void put_binary_number() {
    constexpr std::array<size_t, 4> kSizes = {1, 2, 4, 8};
    const size_t size = kSizes[below(kSizes.size())];
    if (bytes_.size() < size) return;
    const uint64_t value = kBinaryNumbers[below(kBinaryNumbers.size())] - below(2);
    std::array<char, 8> number{};
    std::memcpy(number.data(), &value, number.size());
    if (below(2)) std::reverse(number.begin(), number.begin() + static_cast<std::ptrdiff_t>(size));
    const size_t at = std::min(place(), bytes_.size() - size);
    std::copy_n(number.begin(), size, bytes_.begin() + static_cast<std::ptrdiff_t>(at));
  }
  void replace_word(const std::string& word) {
    const size_t begin = bytes_.find_first_not_of(" \n:,[]{}", place());
    if (begin == std::string::npos) return;
    const size_t end = std::min(bytes_.find_first_of(" \n:,[]{}", begin), bytes_.size());
    bytes_.replace(begin, end - begin, word);
  }
  /// Takes a line out and puts it, once, twice or not at all, somewhere else.
  void move_line() {
    const auto line_begin = [&](size_t at) {
      const size_t before = bytes_.rfind('\n', at);
      return before == std::string::npos || before == at ? size_t{0} : before + 1;
    };
    if (bytes_.empty()) return;
    const size_t begin = line_begin(place());
    const size_t end = std::min(bytes_.find('\n', begin), bytes_.size() - 1) + 1;
    const std::string line = bytes_.substr(begin, end - begin);
    if (below(3)) bytes_.erase(begin, line.size());
    for (size_t copies = below(3); copies > 0 && !bytes_.empty(); --copies)
      bytes_.insert(line_begin(place()), line);
  }

  std::string bytes_;
  std::mt19937_64& random_;
};

bool is_text(const std::string& word) {
  return std::all_of(word.begin(), word.end(),
                     [](char c) { return std::isprint(static_cast<unsigned char>(c)); });
}

}  // namespace

Mutator::Mutator(std::vector<std::string> seeds) : seeds_(std::move(seeds)) {
  std::set<std::string> words;
  for (const std::string& seed : seeds_) {
    for (size_t begin = 0; begin < seed.size();) {
      const size_t end = std::min(seed.find_first_of(" \n", begin), seed.size());
      const std::string word = seed.substr(begin, end - begin);
      if (!word.empty() && word.size() < 40 && is_text(word)) words.insert(word);
      begin = end + 1;
    }
  }
  words_.assign(words.begin(), words.end());
}

std::string Mutator::input(uint64_t seed, uint64_t number) const {
  if (number < seeds_.size()) return seeds_[number];
  std::seed_seq sequence{seed, seed >> 32, number, number >> 32};
  std::mt19937_64 random(sequence);
  Work work(seeds_[random() % seeds_.size()], random);
  for (uint64_t steps = 1 + random() % 5; steps > 0; --steps) work.mutate(seeds_, words_);
  return work.take();
}

}  // namespace gantry::fuzz
