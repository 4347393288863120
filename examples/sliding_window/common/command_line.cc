#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <map>

#include "common/run.h"
#include "common/start.h"

namespace sliding_window {
namespace {

constexpr int kExitUsage = 2;
constexpr char kFlags[] = R"(
  --scene WHICH           hall: a mild start. startup: seconds in which attitude, biases and
                          calibration are hardly determined; SPARSE_SCHUR, 10 iterations, 50
                          images, 90 features; hall
  --frames N              images to play, at least 20; 300
  --features N            features that have a variable at a time, on average, in the hall, 20 to
                          5000; 150
  --seed N                of the simulation, at least 0; 1
  --kick N                not 0: seed of one ulp, up or down, on every value that a solve starts
                          from; 0
  --ordering WHICH        auto: Ceres chooses what is eliminated; landmarks_first; auto
  --linear_solver WHICH   dense_schur, sparse_schur or sparse_normal_cholesky; dense_schur
  --max_iterations N      of a solve, at least 1; 8
  --max_solver_time S     seconds for a solve; without it a run depends on nothing but its arguments
  --json FILE             also write the report to this file
  --help                  this text
)";
constexpr char kOutput[] = R"(
Prints, as JSON: frames; milliseconds of the calls of ceres::Solve (median, p95, max, total); the
absolute trajectory error of the newest frame's position in meters, as evo_ape --align; the same
error without alignment (the first pose's position and yaw are the true ones); the sum of the final
costs. Solves that fail are left out, and counted on standard error. Exit code: 0 success, 1 failure
(of a solve, or to write the report), 2 usage.
)";

// Sets an option from the text of its value; false if the text is no such value.
using Setter = std::function<bool(const std::string&)>;

Setter ToInteger(std::int64_t low, std::int64_t high,
                 const std::function<void(std::int64_t)>& set) {
  return [=](const std::string& text) {
    char* end = nullptr;
    errno = 0;
    const long long value = std::strtoll(text.c_str(), &end, 10);
    const bool fine = errno == 0 && !text.empty() && *end == '\0' && value >= low && value <= high;
    if (fine) {
      set(value);
    }
    return fine;
  };
}

Setter ToInt(int low, int high, int* to) {
  return ToInteger(low, high, [to](std::int64_t value) { *to = static_cast<int>(value); });
}

Setter ToPositive(double* to) {
  return [to](const std::string& text) {
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    const bool fine = !text.empty() && *end == '\0' && value > 0.0;
    *to = fine ? value : *to;
    return fine;
  };
}

template <typename T>
Setter ToChoice(const std::map<std::string, T>& choices, T* to) {
  return [=](const std::string& text) {
    const auto found = choices.find(text);
    if (found == choices.end()) {
      return false;
    }
    *to = found->second;
    return true;
  };
}

std::map<std::string, Setter> MakeSetters(RunOptions* options) {
  EstimatorOptions& estimator = options->estimator;
  return {
      {"--scene",
       [options](const std::string& text) {
         Scene scene = Scene::kHall;
         const bool fine =
             ToChoice<Scene>({{"hall", Scene::kHall}, {"startup", Scene::kStartup}}, &scene)(text);
         SetScene(scene, options);
         return fine;
       }},
      {"--kick", ToInt(0, 1000000, &options->kick)},
      {"--frames", ToInt(20, 1000000, &options->num_frames)},
      {"--features", ToInt(20, 5000, &options->num_features)},
      {"--seed",
       ToInteger(0, INT64_MAX, [options](std::int64_t seed) { options->simulator.seed = seed; })},
      {"--ordering", ToChoice<Ordering>({{"auto", Ordering::kAuto},
                                         {"landmarks_first", Ordering::kLandmarksFirst}},
                                        &estimator.ordering)},
      {"--linear_solver", ToChoice<ceres::LinearSolverType>(
                              {{"dense_schur", ceres::DENSE_SCHUR},
                               {"sparse_schur", ceres::SPARSE_SCHUR},
                               {"sparse_normal_cholesky", ceres::SPARSE_NORMAL_CHOLESKY}},
                              &estimator.linear_solver)},
      {"--max_iterations", ToInt(1, 1000000, &estimator.max_num_iterations)},
      {"--max_solver_time", ToPositive(&estimator.max_solver_time)},
      {"--json",
       [options](const std::string& text) {
         options->json = text;
         return !text.empty();
       }},
  };
}

void PrintHelp(const std::string& usage, const std::vector<Switch>& switches) {
  std::printf("%s\n%s", usage.c_str(), kFlags);
  for (const Switch& known : switches) {
    std::printf("  %-23s %s\n", known.name.c_str(), known.help.c_str());
  }
  std::fputs(kOutput, stdout);
}

struct Argument {
  std::string name;
  std::string value;
};

// The arguments with values, the scene first: what else is said changes it, wherever it stands.
std::vector<Argument> SceneFirst(std::vector<Argument> arguments) {
  std::stable_partition(arguments.begin(), arguments.end(),
                        [](const Argument& a) { return a.name == "--scene"; });
  return arguments;
}

// The argument at *i, whose value may be the next one.
Argument Take(int argc, char** argv, int* i) {
  const std::string text = argv[*i];
  if (const std::size_t equals = text.find('='); equals != std::string::npos) {
    return {text.substr(0, equals), text.substr(equals + 1)};
  }
  return {text, *i + 1 < argc ? argv[++*i] : ""};
}

}  // namespace

std::optional<int> ParseCommandLine(const std::string& usage, int argc, char** argv,
                                    RunOptions* options, const std::vector<Switch>& own_switches) {
  std::vector<Switch> switches{
      {"--free_extrinsics", "estimate where the camera sits on the body; otherwise it is held",
       &options->estimator.free_extrinsics},
      {"--realistic_costs",
       "cost functions that give the same but cost what those of estimators in the field do",
       &options->estimator.realistic_costs}};
  switches.insert(switches.end(), own_switches.begin(), own_switches.end());
  const std::map<std::string, Setter> setters = MakeSetters(options);
  std::vector<Argument> arguments;
  for (int i = 1; i < argc; ++i) {
    const std::string text = argv[i];
    if (text == "--help") {
      PrintHelp(usage, switches);
      return 0;
    }
    const auto known = std::find_if(switches.begin(), switches.end(),
                                    [&](const Switch& a) { return a.name == text; });
    if (known != switches.end()) {
      *known->value = true;
      continue;
    }
    arguments.push_back(Take(argc, argv, &i));
    if (setters.count(arguments.back().name) == 0) {
      std::fprintf(stderr, "%s: unknown argument '%s'; see --help\n", argv[0], text.c_str());
      return kExitUsage;
    }
  }
  for (const auto& [name, value] : SceneFirst(std::move(arguments))) {
    if (!setters.at(name)(value)) {
      std::fprintf(stderr, "%s: %s: '%s' is not a value it can have; see --help\n", argv[0],
                   name.c_str(), value.c_str());
      return kExitUsage;
    }
  }
  return std::nullopt;
}

}  // namespace sliding_window
