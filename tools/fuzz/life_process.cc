#include "tools/fuzz/life_process.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <stdexcept>
#include <string>
#include <thread>

#include <sys/wait.h>

namespace inceres::fuzz {
namespace {

constexpr unsigned kMaxSeconds = 300;

struct NamedCount {
  const char* name;
  long Counts::*member;
};
constexpr NamedCount kCounts[] = {{"edits", &Counts::edits},
                                  {"solves", &Counts::solves},
                                  {"handed_to_stock", &Counts::handed_to_stock},
                                  {"failures", &Counts::failures},
                                  {"not_converged", &Counts::not_converged},
                                  {"unproven", &Counts::unproven},
                                  {"judged", &Counts::judged},
                                  {"creeping", &Counts::creeping},
                                  {"beside_faults", &Counts::beside_faults},
                                  {"as_stock", &Counts::as_stock},
                                  {"unseen_by_stock", &Counts::unseen_by_stock},
                                  {"traces_compared", &Counts::traces_compared},
                                  {"traces_chaotic", &Counts::traces_chaotic}};
constexpr char kWorstCreeping[] = "worst_creeping_excess";

// In the child: lives, and tells the parent.
[[noreturn]] void LiveAndTell(const LifePlan& plan, int pipe) {
  alarm(kMaxSeconds);
  Counts counts;
  std::optional<Defect> defect;
  // A new thread has a heap of its own, untouched: which addresses come back does not depend on
  // what was before.
  std::thread([&] { defect = Live(plan, &counts); }).join();
  nlohmann::json told = {{"counts", ToJson(counts)}};
  if (defect) {
    told["defect"] = {defect->edits, defect->solves, defect->finding.kind, defect->finding.detail};
  }
  const std::string text = told.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  std::fflush(nullptr);
  // less than a pipe holds
  const bool written = write(pipe, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  _exit(written ? 0 : 1);
}

std::string ReadAll(int pipe) {
  std::string text;
  char buffer[4096];
  for (ssize_t count = 0; (count = read(pipe, buffer, sizeof buffer)) > 0;) {
    text.append(buffer, static_cast<std::size_t>(count));
  }
  return text;
}

Defect Crash(const LifePlan& plan, int status) {
  const std::string cause = WIFSIGNALED(status)
                                ? strsignal(WTERMSIG(status))
                                : "exit code " + std::to_string(WEXITSTATUS(status));
  return {plan, 0, 0, {"crash", "the life ended by " + cause + "; --verbose tells after what"}};
}

}  // namespace

void Add(const Counts& counts, Counts* sum) {
  for (const NamedCount& count : kCounts) {
    sum->*count.member += counts.*count.member;
  }
  sum->worst_creeping_excess = std::max(sum->worst_creeping_excess, counts.worst_creeping_excess);
}

nlohmann::json ToJson(const Counts& counts) {
  nlohmann::json json = {{kWorstCreeping, counts.worst_creeping_excess}};
  for (const NamedCount& count : kCounts) {
    json[count.name] = counts.*count.member;
  }
  return json;
}

std::optional<Defect> LiveInProcess(const LifePlan& plan, Counts* counts) {
  int ends[2];
  if (pipe(ends) != 0) {
    throw std::runtime_error("no pipe to a life's own process");
  }
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child < 0) {
    throw std::runtime_error("no process for a life");
  }
  if (child == 0) {
    close(ends[0]);
    LiveAndTell(plan, ends[1]);
  }
  close(ends[1]);
  const std::string text = ReadAll(ends[0]);
  close(ends[0]);
  int status = 0;
  waitpid(child, &status, 0);
  if (status != 0) {
    return Crash(plan, status);
  }
  const nlohmann::json told = nlohmann::json::parse(text);
  Counts lived;
  for (const NamedCount& count : kCounts) {
    lived.*count.member = told["counts"][count.name];
  }
  lived.worst_creeping_excess = told["counts"][kWorstCreeping];
  Add(lived, counts);
  if (told.count("defect") == 0) {
    return std::nullopt;
  }
  const nlohmann::json& defect = told["defect"];
  return Defect{plan, defect[0], defect[1], {defect[2], defect[3]}};
}

}  // namespace inceres::fuzz
