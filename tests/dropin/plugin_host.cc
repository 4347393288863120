// A program without Ceres that loads a plugin which has it: plugin_host PLUGIN local|deep WAY.
// RTLD_LOCAL either way; deep is RTLD_DEEPBIND too. It unloads the plugin before it ends.
#include <dlfcn.h>

#include <cstdio>
#include <cstring>

int main(int argc, char** argv) {
  if (argc != 4) {
    return 2;
  }
  void* plugin = dlopen(
      argv[1], RTLD_NOW | RTLD_LOCAL | (std::strcmp(argv[2], "deep") == 0 ? RTLD_DEEPBIND : 0));
  if (plugin == nullptr) {
    std::fprintf(stderr, "%s\n", dlerror());
    return 3;
  }
  const auto solve = reinterpret_cast<int (*)(const char*)>(dlsym(plugin, "SolveInWay"));
  const int result = solve == nullptr ? 4 : solve(argv[3]);
// for the leak checker, which does not find what the globals of an unloaded library held
#if defined(__SANITIZE_ADDRESS__)
  return result;
#else
  return dlclose(plugin) == 0 ? result : 5;
#endif
}
