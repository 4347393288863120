// Megabytes of text a second, one core: BAL files as the public data sets have them ("%.16e") and
// as WriteBal writes them (the shortest form), plain and compressed. At least 100 MB/s of text are
// asked of the plain ones.
//
//   build/bin/bal_reading_benchmark [--benchmark_filter=Public]

#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <string>

#include <benchmark/benchmark.h>

#include "inceres/io/bal.h"
#include "tools/sim/street_scene.h"

namespace inceres {
namespace {

BalProblem Street(benchmark::State& state) {
  StreetSceneOptions options;
  options.num_cameras = 1000;
  options.num_points = 200000;
  options.num_observations = 1000000;
  StreetScene scene;
  if (!GenerateStreetScene(options, &scene).ok()) {
    state.SkipWithError("the scene could not be generated");
  }
  return scene.problem;
}

// As the BAL site's files: observations with seven digits, everything else with seventeen.
Status WriteAsPublished(const std::string& path, const BalProblem& problem) {
  std::FILE* file = std::fopen(path.c_str(), "w");
  if (file == nullptr) {
    return Status::Error(StatusCode::kIo, path + ": cannot open for writing");
  }
  std::fprintf(file, "%d %d %zu\n", problem.num_cameras, problem.num_points,
               problem.observations.size());
  for (const BalObservation& o : problem.observations) {
    std::fprintf(file, "%d %d     %.6e %.6e\n", o.camera, o.point, o.x, o.y);
  }
  for (const std::vector<double>* values : {&problem.cameras, &problem.points}) {
    for (const double value : *values) {
      std::fprintf(file, "%.16e\n", value);
    }
  }
  return std::fclose(file) == 0 ? Status::Ok()
                                : Status::Error(StatusCode::kIo, path + ": cannot write");
}

// A file for the time of a benchmark.
struct TemporaryFile {
  explicit TemporaryFile(const std::string& ending)
      : path(std::filesystem::temp_directory_path() /
             ("bal_reading_" + std::to_string(getpid()) + ending)) {}
  ~TemporaryFile() {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
  }
  std::string path;
};

template <typename Write>
void Measure(benchmark::State& state, const std::string& ending, const Write& write) {
  const BalProblem problem = Street(state);
  const TemporaryFile text(".txt");
  const TemporaryFile file(ending);
  if (!write(text.path, problem).ok() || !write(file.path, problem).ok()) {
    state.SkipWithError("the file could not be written");
    return;
  }
  for (auto _ : state) {
    BalProblem read;
    if (!ReadBal(file.path, &read).ok() ||
        read.observations.size() != problem.observations.size()) {
      state.SkipWithError("the file could not be read");
      return;
    }
    benchmark::DoNotOptimize(read.points.data());
  }
  state.SetBytesProcessed(
      static_cast<std::int64_t>(state.iterations() * std::filesystem::file_size(text.path)));
}

void BM_ReadPublished(benchmark::State& state) {
  Measure(state, ".published.txt", WriteAsPublished);
}
BENCHMARK(BM_ReadPublished)->Unit(benchmark::kMillisecond);

void BM_ReadShortest(benchmark::State& state, const char* ending) {
  Measure(state, ending, WriteBal);
}
BENCHMARK_CAPTURE(BM_ReadShortest, plain, ".shortest.txt")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(BM_ReadShortest, gzip, ".shortest.txt.gz")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(BM_ReadShortest, bzip2, ".shortest.txt.bz2")->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace inceres
