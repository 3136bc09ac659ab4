// Operators new and delete of the test program, which count.
#include "counting_new.h"

#include <cstdlib>
#include <new>

namespace {

thread_local std::size_t allocations = 0;
thread_local std::size_t requestedBytes = 0;

void* allocate(std::size_t size) {
  ++allocations;
  requestedBytes += size;
  return std::malloc(size > 0 ? size : 1);
}

void* allocateOrAbort(std::size_t size) {
  void* const memory = allocate(size);
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

std::size_t allocatedBytes() {
  return requestedBytes;
}

}  // namespace terraport_tests

void* operator new(std::size_t size) {
  return allocateOrAbort(size);
}
void* operator new[](std::size_t size) {
  return allocateOrAbort(size);
}
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  return allocate(size);
}
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept {
  return allocate(size);
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
