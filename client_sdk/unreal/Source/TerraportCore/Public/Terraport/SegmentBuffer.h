// Memory that is filled again and again.
#pragma once

#include <cstddef>
#include <memory>
#include <new>
#include <type_traits>

namespace terraport {

/// An array of numbers that keeps its memory when it becomes smaller, and is not cleared when it becomes larger: in a steady
/// state nothing is allocated. Not copyable.
template <typename T>
class SegmentBuffer {
  static_assert(std::is_trivially_copyable_v<T>, "numbers only");

 public:
  /// Give it `size` entries; what they hold is not said. False where there is no memory, and then it is empty.
  [[nodiscard]] bool resize(std::size_t size) {
    if (size > capacity_) {
      // An eighth more, so that segments of about one size do not make it grow each time.
      const std::size_t capacity = size + size / 8;
      data_.reset(new (std::nothrow) T[capacity]);
      capacity_ = data_ ? capacity : 0;
    }
    size_ = size <= capacity_ ? size : 0;
    return size_ == size;
  }

  /// Empty it; the memory is kept.
  void clear() { size_ = 0; }

  T* data() { return data_.get(); }
  const T* data() const { return data_.get(); }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  /// Bytes that it holds on to.
  std::size_t capacityBytes() const { return capacity_ * sizeof(T); }

  T& operator[](std::size_t at) { return data_[at]; }
  const T& operator[](std::size_t at) const { return data_[at]; }
  T* begin() { return data_.get(); }
  T* end() { return data_.get() + size_; }
  const T* begin() const { return data_.get(); }
  const T* end() const { return data_.get() + size_; }

 private:
  std::unique_ptr<T[]> data_;
  std::size_t size_ = 0;
  std::size_t capacity_ = 0;
};

}  // namespace terraport
