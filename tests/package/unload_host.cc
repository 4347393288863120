// unload_host PLUGIN: loads unload_plugin, calls it and unloads it, again and again. Threads that
// have worked for it sleep meanwhile, and wake up: what they run in must still be there.
#include <dlfcn.h>

#include <chrono>
#include <cstdio>
#include <thread>

int main(int argc, char** argv) {
  constexpr int kCount = 500;
  for (int round = 0; argc == 2 && round < 3; ++round) {
    void* const plugin = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    if (plugin == nullptr) {
      std::fprintf(stderr, "%s\n", dlerror());
      return 1;
    }
    const auto count = reinterpret_cast<int (*)(int)>(dlsym(plugin, "CountOnTwoThreads"));
    if (count == nullptr || count(kCount) != kCount) {
      return 2;
    }
    if (dlclose(plugin) != 0) {
      return 3;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
  return argc == 2 ? 0 : 4;
}
