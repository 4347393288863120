// Random problems with random lives, solved by ours and judged by plain LM: see differential_fuzzer
// --help and docs/fuzzing.md.

#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <gflags/gflags.h>
#include <glog/logging.h>
#include <nlohmann/json.hpp>
#include <sys/wait.h>

#include "src/base/stopwatch.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/json_report.h"
#include "tools/command_line/output.h"
#include "tools/command_line/progress_lines.h"
#include "tools/fuzz/life_process.h"
#include "tools/fuzz/solver.h"

DEFINE_string(mode, "all",
              "Which solver is under test: exact, incremental, session, dropin, "
              "dropin_incremental, auto, or several, separated by "
              "commas, or all of them; stock: Ceres itself, for comparison.");
DEFINE_uint64(seed, 1, "The same seed gives the same lives.");
DEFINE_uint64(first_life, 0, "Begins with this life of the seed.");
DEFINE_uint64(lives, 100, "How many lives in each mode.");
DEFINE_int32(edits, 60, "Edits of a life; it is solved after every few.");
DEFINE_int32(max_threads, 2,
             "Most threads of a solve, 1 or 2. With 1 a life of a session repeats: two threads "
             "shuffle the addresses of memory that comes back, and a session's sums follow them.");
DEFINE_bool(bounds, false,
            "Give a third of the parameter blocks bounds, in all modes; without it a life may have "
            "some where stock's iterates are followed.");
DEFINE_bool(degenerate, false,
            "Only cameras and points, without guards: points that go next to a camera's center, "
            "mismatches whose inverse depths tend to infinity.");
DEFINE_bool(judge_by_stock, false,
            "An end is too high only where Ceres as well, started there with the options of the "
            "solve, gains more than ten tolerances, and no verdict is no defect: a life goes on "
            "past ends that Ceres's own test would pass.");
DEFINE_double(seconds, 0.0, "No new life begins in a mode after so many seconds; 0: no limit.");
DEFINE_bool(verbose, false,
            "Print every edit and solve, and the iterations of the one that is a defect.");

namespace inceres::fuzz {
namespace {

using tools::ExitCode;

const tools::ToolHelp kHelp = {
    "Let random problems live random lives, solve them often, judge every end.",
    "A solver of ours solves, plain Levenberg-Marquardt judges. A defect is exit code 1, and "
    "printed with the command that repeats it; docs/fuzzing.md tells what counts as one. --json "
    "appends a line for each mode to its file.",
    {{"a thousand lives", "differential_fuzzer --mode session --lives 1000"},
     {"a night of all modes, less than three hours each",
      "differential_fuzzer --seed 7 --lives 1000000 --seconds 10000 --json night.jsonl"}}};

// The modes that need the drop-in in Ceres's place: this program's sibling has them.
struct DropInMode {
  const char* name;
  const char* environment;
};
constexpr DropInMode kDropInModes[] = {
    {"dropin", "exact"}, {"dropin_incremental", "incremental"}, {"auto", "auto"}};

std::vector<std::string> Split(const std::string& list) {
  std::vector<std::string> words(1);
  for (const char c : list) {
    if (c == ',') {
      words.emplace_back();
    } else {
      words.back() += c;
    }
  }
  return words;
}

nlohmann::json ToJson(const Defect& defect) {
  return {{"seed", defect.plan.seed},    {"life", defect.plan.life},
          {"edits", defect.edits},       {"solves", defect.solves},
          {"kind", defect.finding.kind}, {"detail", defect.finding.detail}};
}

// A defect is told whatever --quiet says, and never among JSON.
void Print(const Defect& defect) {
  const LifePlan& plan = defect.plan;
  std::FILE* const out = tools::Out() == stdout ? stdout : stderr;
  std::fprintf(out, "DEFECT %s, mode %s, seed %ju, life %ju, after %ld edits, solve %ld: %s\n",
               defect.finding.kind.c_str(), plan.mode.c_str(),
               static_cast<std::uintmax_t>(plan.seed), static_cast<std::uintmax_t>(plan.life),
               defect.edits, defect.solves, defect.finding.detail.c_str());
  std::fprintf(out,
               "  differential_fuzzer --mode %s --seed %ju --first_life %ju --lives 1 --edits %d "
               "--max_threads %d%s%s%s\n",
               plan.mode.c_str(), static_cast<std::uintmax_t>(plan.seed),
               static_cast<std::uintmax_t>(plan.life), plan.max_edits, plan.max_threads,
               plan.bounds ? " --bounds" : "", plan.degenerate ? " --degenerate" : "",
               plan.judges == Judges::kStock ? " --judge_by_stock" : "");
  std::fflush(out);
}

struct ModeResult {
  std::string mode;
  std::uint64_t lives = 0;
  double seconds = 0.0;
  Counts counts;
  std::vector<Defect> defects;
};

ModeResult RunMode(const std::string& mode) {
  ModeResult result;
  result.mode = mode;
  const double begin = internal::NowInSeconds();
  tools::ProgressLines progress(tools::ProgressOutput());
  while (result.lives < FLAGS_lives && (FLAGS_seconds <= 0.0 || result.seconds < FLAGS_seconds)) {
    const LifePlan plan{FLAGS_seed,
                        FLAGS_first_life + result.lives,
                        mode,
                        FLAGS_edits,
                        FLAGS_max_threads,
                        FLAGS_bounds,
                        FLAGS_degenerate,
                        FLAGS_judge_by_stock ? Judges::kStock : Judges::kDescent,
                        FLAGS_verbose};
    if (const std::optional<Defect> defect = LiveInProcess(plan, &result.counts)) {
      Print(*defect);
      result.defects.push_back(*defect);
    }
    ++result.lives;
    progress([&] {
      return mode + ": " + std::to_string(result.lives) + " of " + std::to_string(FLAGS_lives) +
             " lives, " + std::to_string(result.defects.size()) + " defects";
    });
    result.seconds = internal::NowInSeconds() - begin;
  }
  return result;
}

Status Report(const ModeResult& result) {
  const Counts& c = result.counts;
  std::fprintf(
      tools::Out(),
      "%s: %ju lives, %ld edits, %ld solves in %.1f s; %ld judged, %ld creeping (worst %.2g "
      "tolerances), %ld beside faults, "
      "%ld as far as stock, %ld that stock would not leave; traces: %ld compared, %ld chaotic; %ld "
      "handed to stock, %ld failures "
      "with a cause, %ld ended by a "
      "limit (%ld unproven); %zu defects\n",
      result.mode.c_str(), static_cast<std::uintmax_t>(result.lives), c.edits, c.solves,
      result.seconds, c.judged, c.creeping, c.worst_creeping_excess, c.beside_faults, c.as_stock,
      c.unseen_by_stock, c.traces_compared, c.traces_chaotic, c.handed_to_stock, c.failures,
      c.not_converged, c.unproven, result.defects.size());
  std::fflush(tools::Out());
  nlohmann::json line = ToJson(c);
  line.update({{"mode", result.mode},
               {"seed", FLAGS_seed},
               {"first_life", FLAGS_first_life},
               {"lives", result.lives},
               {"seconds", result.seconds},
               {"defects", nlohmann::json::array()}});
  for (const Defect& defect : result.defects) {
    line["defects"].push_back(ToJson(defect));
  }
  return tools::AppendJsonReport(line);
}

// Runs the sibling that is linked to the drop-in, with this program's flags; returns its exit code.
int RunSibling(const DropInMode& mode) {
  const auto sibling =
      std::filesystem::read_symlink("/proc/self/exe").parent_path() / "differential_fuzzer_dropin";
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child == 0) {
    setenv("INCERES_MODE", mode.environment, 1);
    setenv("INCERES_WINDOWS", "incremental", 1);  // small as these problems are
    std::vector<std::string> words = {sibling.string(), std::string("--mode=") + mode.name};
    for (const char* flag :
         {"seed", "first_life", "lives", "edits", "max_threads", "bounds", "degenerate",
          "judge_by_stock", "seconds", "json", "verbose", "quiet", "progress"}) {
      words.push_back(std::string("--") + flag + "=" +
                      gflags::GetCommandLineFlagInfoOrDie(flag).current_value);
    }
    std::vector<char*> arguments;
    arguments.reserve(words.size() + 1);
    for (std::string& word : words) {
      arguments.push_back(word.data());
    }
    arguments.push_back(nullptr);
    execv(arguments[0], arguments.data());
    std::_Exit(tools::Fail(ExitCode::kExitFailure,
                           "cannot run " + words[0] + ", which has the mode " + mode.name));
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : static_cast<int>(ExitCode::kExitFailure);
}

const DropInMode* FindDropInMode(const std::string& name) {
  const auto* const found = std::find_if(std::begin(kDropInModes), std::end(kDropInModes),
                                         [&](const DropInMode& mode) { return name == mode.name; });
  return found != std::end(kDropInModes) ? found : nullptr;
}

// Runs each of the modes where it is; the highest exit code of them.
int RunModes(const std::vector<std::string>& wanted) {
  if (FLAGS_verbose && tools::Out() != stdout) {
    return tools::Fail(ExitCode::kExitUsage,
                       "--verbose prints, which --quiet and --json - do not let it");
  }
  if (const Status status = tools::CheckNumbers({}, {{"--seconds", FLAGS_seconds}}); !status.ok()) {
    return tools::Fail(ExitCode::kExitUsage, status.message);
  }
  if (FLAGS_max_threads < 1 || FLAGS_max_threads > 2) {
    return tools::Fail(ExitCode::kExitUsage,
                       "--max_threads is " + std::to_string(FLAGS_max_threads) + ", not 1 or 2");
  }
  const std::vector<std::string> modes_here = Modes();
  const auto is_here = [&](const std::string& mode) {
    return std::find(modes_here.begin(), modes_here.end(), mode) != modes_here.end();
  };
  for (const std::string& mode : wanted) {
    if (!is_here(mode) && FindDropInMode(mode) == nullptr) {
      return tools::Fail(ExitCode::kExitUsage, "--mode: there is no mode '" + mode + "'");
    }
  }
  int worst = tools::kExitSuccess;
  for (const std::string& mode : wanted) {
    if (is_here(mode)) {
      const ModeResult result = RunMode(mode);
      if (const Status status = Report(result); !status.ok()) {
        return tools::Fail(ExitCode::kExitFailure, status.message);
      }
      worst =
          std::max<int>(worst, result.defects.empty() ? tools::kExitSuccess : tools::kExitFailure);
    } else {
      worst = std::max(worst, RunSibling(*FindDropInMode(mode)));
    }
  }
  return worst;
}

std::vector<std::string> WantedModes() {
  if (FLAGS_mode != "all") {
    return Split(FLAGS_mode);
  }
  std::vector<std::string> modes = Modes();
  modes.erase(std::remove(modes.begin(), modes.end(), kStockMode), modes.end());
  for (const DropInMode& mode : kDropInModes) {
    modes.emplace_back(mode.name);
  }
  return modes;
}

}  // namespace
}  // namespace inceres::fuzz

int main(int argc, char** argv) {
  // Not from the heap: lives are to go the same way whether they are told of or not. By lines, so
  // that what a life has told is not lost if a signal ends it.
  static char written[BUFSIZ];
  std::setvbuf(stdout, written, _IOLBF, sizeof written);
  FLAGS_minloglevel = google::GLOG_FATAL;  // every failure that is provoked here has its message
  google::InitGoogleLogging(argv[0]);
  if (const std::optional<int> exit_code =
          inceres::tools::ParseCommandLine(inceres::fuzz::kHelp, &argc, &argv)) {
    return *exit_code;
  }
  try {
    return inceres::fuzz::RunModes(inceres::fuzz::WantedModes());
  } catch (const std::exception& error) {
    return inceres::tools::Fail(inceres::tools::kExitFailure, error.what());
  }
}
