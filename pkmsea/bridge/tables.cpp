// The choice among the lanes that were built (see lanes.hpp).
#include "lanes.hpp"

#include <cstring>

namespace lanes {

extern const Table plain;
#ifdef LANES_AVX
extern const Table avx2, avx512;
#endif

static const Table *const *usable() {
  static const Table *found[4] = {};
  if (!found[0]) {
    int n = 0;
#ifdef LANES_AVX
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) found[n++] = &avx512;
    if (__builtin_cpu_supports("avx2")) found[n++] = &avx2;
#endif
    found[n] = &plain;
  }
  return found;
}

const Table &best() { return *usable()[0]; }

const Table *named(const char *name) {
  for (const Table *const *table = usable(); *table; ++table)
    if (!std::strcmp((*table)->name, name)) return *table;
  return nullptr;
}

const char *const *names() {
  static const char *found[4] = {};
  for (int i = 0; usable()[i]; ++i) found[i] = usable()[i]->name;
  return found;
}

long work_size(int n, int columns) { return (long(n) * n + 2L * n + columns) * WIDEST; }

}  // namespace lanes
