// Operators new and delete of the test program, which count.
#include "counting_new.h"

#include <cstdlib>
#include <new>

namespace {

thread_local std::size_t allocations = 0;

void* taken(std::size_t size) {
  ++allocations;
  return std::malloc(size > 0 ? size : 1);
}

void* takenOrEnd(std::size_t size) {
  void* const memory = taken(size);
  if (memory == nullptr) {
    std::abort();
  }
  return memory;
}

}  // namespace

namespace terraport_tests {

std::size_t allocationCount() {
  return allocations;
}

}  // namespace terraport_tests

void* operator new(std::size_t size) {
  return takenOrEnd(size);
}
void* operator new[](std::size_t size) {
  return takenOrEnd(size);
}
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  return taken(size);
}
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept {
  return taken(size);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete[](void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete(void* memory, const std::nothrow_t&) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, const std::nothrow_t&) noexcept {
  std::free(memory);
}
