#pragma once

#include <sys/mman.h>

#include <array>
#include <bit>
#include <cstddef>
#include <new>
#include <type_traits>
#include <utility>

namespace gantry::internal {

/// An array that grows at its end and never moves: segments of doubling size, straight from the system. So
/// growing needs no second copy, pages not yet written cost nothing, and what is released is really given
/// back (memory freed to the allocator may stay with the process). Elements start as all zero bytes.
template <class T>
class PagedArray {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  PagedArray() = default;
  PagedArray(const PagedArray&) = delete;
  PagedArray& operator=(const PagedArray&) = delete;
  ~PagedArray() { release(); }

  size_t size() const { return size_; }
  size_t bytes() const { return size_ * sizeof(T); }

  T& operator[](size_t i) {
    const int segment = segment_of(i);
    return segments_[segment][i + kFirst - (kFirst << segment)];
  }
  const T& operator[](size_t i) const { return const_cast<PagedArray&>(*this)[i]; }

  /// The new last element.
  T& grow() {
    const int segment = segment_of(size_);
    if (!segments_[segment]) {
      void* pages = mmap(nullptr, (kFirst << segment) * sizeof(T), PROT_READ | PROT_WRITE,
                         MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
      if (pages == MAP_FAILED) throw std::bad_alloc();
      segments_[segment] = static_cast<T*>(pages);
    }
    return (*this)[size_++];
  }

  void release() {
    for (size_t k = 0; k < segments_.size(); ++k)
      if (T* pages = std::exchange(segments_[k], nullptr)) munmap(pages, (kFirst << k) * sizeof(T));
    size_ = 0;
  }

 private:
  /// Elements of the first segment: up to 1 MB, so that small arrays take one call to the system.
  static constexpr size_t kFirst = std::bit_floor((size_t{1} << 20) / sizeof(T));
  static constexpr int kFirstBits = std::bit_width(kFirst) - 1;
  /// Segment k begins at element (2^k - 1) kFirst.
  static int segment_of(size_t i) { return std::bit_width((i >> kFirstBits) + 1) - 1; }

  std::array<T*, 32> segments_{};
  size_t size_ = 0;
};

}  // namespace gantry::internal
