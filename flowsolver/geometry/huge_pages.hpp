// Storage of large arrays that are read from end to end while a program that shares the caches throws their addresses out of the processor's tables.
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdlib>
#include <new>

namespace poreslip::geometry {

// For std::vector: asks the system for pages of 2 MiB where an array fills one, which saves a third of the time of a pass that finds neither
// data nor addresses near. The system may decline; nothing but time depends on it.
template <class T>
struct HugePages {
  using value_type = T;
  static constexpr std::size_t page = std::size_t{1} << 21;

  HugePages() = default;
  template <class Other>
  HugePages(const HugePages<Other>&) {}

  T* allocate(std::size_t count) {
    const std::size_t bytes = count * sizeof(T), alignment = bytes < page ? alignof(T) : page;
    const std::size_t rounded = (bytes + alignment - 1) / alignment * alignment;
    void* const memory = std::aligned_alloc(alignment, rounded);
    if (!memory) throw std::bad_alloc();
    if (alignment == page) madvise(memory, rounded, MADV_HUGEPAGE);
    return static_cast<T*>(memory);
  }
  void deallocate(T* memory, std::size_t) { std::free(memory); }

  template <class Other>
  bool operator==(const HugePages<Other>&) const { return true; }
};

}  // namespace poreslip::geometry
