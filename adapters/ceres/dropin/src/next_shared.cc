// The next Ceres of a process that loads the drop-in ahead of a shared Ceres.
#include <dlfcn.h>
#include <link.h>

#include <cstddef>
#include <string>

#include <glog/logging.h>

#include "adapters/ceres/dropin/src/ceres_symbols.h"

namespace inceres::internal {
namespace {

constexpr char kSoname[] = INCERES_CERES_SONAME;  // of the release that was compiled for

// What it is called in messages.
std::string Release() {
  return "Ceres " + std::to_string(CERES_VERSION_MAJOR) + "." + std::to_string(CERES_VERSION_MINOR);
}

// What tells releases apart: functions that it must have, and must not have.
struct Feature {
  const char* symbol;
  bool expected;
};
constexpr Feature kFeatures[] = {
    {"_ZNK5ceres7Problem11GetManifoldEPKd", INCERES_CERES_HAS_MANIFOLDS},
    {"_ZNK5ceres7Problem19GetParameterizationEPKd", INCERES_CERES_HAS_LOCAL_PARAMETERIZATIONS},
};

// What is known of the shared object that an address lies in.
struct Library {
  const void* base = nullptr;
  std::string file;
  std::string soname;
};

// DT_SONAME of a loaded object; empty if it has none.
std::string SonameOf(const link_map& map) {
  const char* strings = nullptr;
  ElfW(Xword) offset = 0;
  for (const ElfW(Dyn)* entry = map.l_ld; entry->d_tag != DT_NULL; ++entry) {
    if (entry->d_tag == DT_STRTAB) {
      // The loader has turned it into an address, on most machines.
      const ElfW(Addr) address =
          entry->d_un.d_ptr < map.l_addr ? map.l_addr + entry->d_un.d_ptr : entry->d_un.d_ptr;
      const auto from_here =
          static_cast<std::ptrdiff_t>(address - reinterpret_cast<ElfW(Addr)>(map.l_ld));
      strings = reinterpret_cast<const char*>(map.l_ld) + from_here;
    } else if (entry->d_tag == DT_SONAME) {
      offset = entry->d_un.d_val;
    }
  }
  return strings != nullptr && offset != 0 ? strings + offset : "";
}

Library LibraryOf(const void* address) {
  Library library;
  Dl_info info;
  void* map = nullptr;
  if (address != nullptr && dladdr1(address, &info, &map, RTLD_DL_LINKMAP) != 0 && map != nullptr) {
    library.base = info.dli_fbase;
    library.file = info.dli_fname != nullptr ? info.dli_fname : "";
    library.soname = SonameOf(*static_cast<const link_map*>(map));
  }
  return library;
}

// Why the Ceres that `solve` belongs to is not the one whose headers we know, or an empty string.
std::string Mismatch(const void* solve) {
  const Library ceres = LibraryOf(solve);
  if (ceres.base == nullptr) {
    return "no shared library behind this one has ceres::Solver::Solve";
  }
  if (ceres.soname != kSoname) {
    return ceres.file + " (" + (ceres.soname.empty() ? "no SONAME" : "SONAME " + ceres.soname) +
           ")";
  }
  for (const Feature& feature : kFeatures) {
    const bool found = LibraryOf(dlsym(RTLD_NEXT, feature.symbol)).base == ceres.base;
    if (found != feature.expected) {
      return ceres.file + (found ? " (with " : " (without ") + feature.symbol + ", so it is not " +
             Release() + ")";
    }
  }
  return "";
}

// Whether whoever looks for a function of Ceres finds it here, as where this library was preloaded
// or the program is linked to it: not where a module that is linked to it was loaded for itself
// alone (RTLD_LOCAL), for others then find Ceres's own.
bool IsFoundFirst() {
  void* const program = dlopen(nullptr, RTLD_LAZY);
  if (program == nullptr) {
    return false;
  }
  const void* const here = LibraryOf(reinterpret_cast<const void*>(&Next)).base;
  bool any = false;
  bool all = true;
#define INCERES_LOOK_FOR(name, symbol, ...)                                 \
  if (const void* const found = dlsym(program, symbol); found != nullptr) { \
    any = true;                                                             \
    all = all && LibraryOf(found).base == here;                             \
  }
  INCERES_CERES_SYMBOLS(INCERES_LOOK_FOR)
#undef INCERES_LOOK_FOR
  dlclose(program);
  return any && all;
}

NextCeres FindNext() {
  NextCeres next;
#define INCERES_FIND_NEXT(name, symbol, ...) \
  next.name = reinterpret_cast<decltype(next.name)>(dlsym(RTLD_NEXT, symbol));
  INCERES_CERES_SYMBOLS(INCERES_FIND_NEXT)
#undef INCERES_FIND_NEXT
  const std::string found = Mismatch(reinterpret_cast<const void*>(next.SolverSolve));
  next.is_ours = found.empty();
  next.sees_all_calls = next.is_ours && IsFoundFirst();
  if (!next.is_ours) {
    LOG(WARNING) << "inceres: the drop-in is for " << Release() << " (" << kSoname << ") and found "
                 << found << "; it stands aside, and that Ceres solves everything.";
  }
  return next;
}

}  // namespace

const NextCeres& Next() {
  static const NextCeres kNext = FindNext();
  return kNext;
}

}  // namespace inceres::internal
