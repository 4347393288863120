// The drop-in from outside: a program that knows only Ceres, run bare and with the drop-in in front
// of Ceres.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "dropin/run_program.h"
#include "support/temp_dir.h"

namespace inceres::testing {
namespace {

// Every way a program has of solving that the program knows; with --wrap those that do not go
// through the virtual table.
const std::vector<std::string> kWays = {"free",  "member",  "virtual",
                                        "c_api", "derived", "evaluation_callback",
                                        "moved", "living",  "covariance"};

// The Ceres it would meet without us, whatever the environment of the test says.
ProgramRun Bare(const std::string& way) {
  return RunProgram(INCERES_PLAIN_PROGRAM, way, "");
}

ProgramRun Preloaded(const std::string& way, const std::string& environment = "") {
  return RunProgram(INCERES_PLAIN_PROGRAM, way, "LD_PRELOAD=" INCERES_DROPIN " " + environment);
}

// As a plugin of a program that has no Ceres. `scope`: as plugin_host.cc has it.
ProgramRun AsPlugin(const std::string& plugin, const std::string& way,
                    const std::string& environment = "", const std::string& scope = "local") {
  return RunProgram(INCERES_PLUGIN_HOST, plugin + " " + scope + " " + way, environment);
}

int NumSolved(const ProgramRun& run) {
  const std::string text = "inceres solved ";
  const std::size_t place = run.err.find(text);
  return place == std::string::npos ? -1 : std::atoi(run.err.c_str() + place + text.size());
}

int CountOf(const std::string& text, const std::string& part) {
  int count = 0;
  for (std::size_t place = 0; (place = text.find(part, place)) != std::string::npos;
       place += part.size()) {
    ++count;
  }
  return count;
}

// Ceres's own report and table, which the C interface prints, without their times.
std::string WithoutTimes(const std::string& text) {
  std::string result;
  bool times = false;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    static const std::regex kRow(R"(^( +\d+( +\S+){7}) +\S+ +\S+$)");  // of the progress table
    times = times || line == "Time (in seconds):";
    if (!times) {
      result += std::regex_replace(line, kRow, "$1") + "\n";
    }
    times = times && line.rfind("Total ", 0) != 0;
  }
  return result;
}

// Words must be equal and numbers close. What tells of the termination ends with a number of
// rounding's size.
void ExpectSameOutput(const std::string& stock, const std::string& ours, double tolerance) {
  std::istringstream a(WithoutTimes(stock));
  std::istringstream b(WithoutTimes(ours));
  std::string line_a;
  std::string line_b;
  while (std::getline(a, line_a)) {
    ASSERT_TRUE(static_cast<bool>(std::getline(b, line_b))) << "missing: " << line_a;
    if (line_a.find("ermination") != std::string::npos) {
      EXPECT_EQ(line_a.substr(0, line_a.rfind(':')), line_b.substr(0, line_b.rfind(':')));
      continue;
    }
    std::istringstream words_a(line_a);
    std::istringstream words_b(line_b);
    std::string word_a;
    std::string word_b;
    while (words_a >> word_a) {
      ASSERT_TRUE(static_cast<bool>(words_b >> word_b)) << line_a << "\n" << line_b;
      char* end_a = nullptr;
      const double x = std::strtod(word_a.c_str(), &end_a);
      const double y = std::strtod(word_b.c_str(), nullptr);
      if (end_a == word_a.c_str()) {
        EXPECT_EQ(word_a, word_b) << line_a;
      } else {
        EXPECT_LE(std::abs(x - y), tolerance * std::max(1.0, std::abs(x))) << line_a << "\n"
                                                                           << line_b;
      }
    }
  }
  EXPECT_FALSE(static_cast<bool>(std::getline(b, line_b))) << "more: " << line_b;
}

class EveryWay : public ::testing::TestWithParam<std::string> {};

TEST_P(EveryWay, PreloadedSolvesAsStockDoes) {
  const ProgramRun stock = Bare(GetParam());
  const ProgramRun ours = Preloaded(GetParam());
  ASSERT_EQ(stock.exit_code, 0) << stock.err;
  ASSERT_EQ(ours.exit_code, 0) << ours.err;
  ASSERT_GT(stock.out.size(), 0u);
  EXPECT_EQ(NumSolved(stock), -1);
  EXPECT_GT(NumSolved(ours), 0) << ours.err;
  EXPECT_EQ(CountOf(ours.err, "the drop-in solves for Ceres, mode exact"), 1) << ours.err;
  EXPECT_EQ(CountOf(ours.err, "handed to stock"), 0) << ours.err;
  ExpectSameOutput(stock.out, ours.out, 1e-8);
}

TEST_P(EveryWay, LinkedInCeresPlaceSolvesAsStockDoes) {
  const ProgramRun ours = RunProgram(INCERES_LINKED_PROGRAM, GetParam(), "");
  ASSERT_EQ(ours.exit_code, 0) << ours.err;
  EXPECT_EQ(WithoutTimes(ours.out), WithoutTimes(Preloaded(GetParam()).out));
  EXPECT_GT(NumSolved(ours), 0) << ours.err;
}

TEST_P(EveryWay, WrappedStaticCeresSolvesAsStockDoes) {
  if (INCERES_CERES_IS_STATIC == 0) {
    GTEST_SKIP()
        << "Ceres::ceres is shared here, and what calls ceres::Solve inside it cannot be wrapped";
  }
  const ProgramRun ours = RunProgram(INCERES_WRAPPED_PROGRAM, GetParam(), "");
  ASSERT_EQ(ours.exit_code, 0) << ours.err;
  ExpectSameOutput(Bare(GetParam()).out, ours.out, 1e-8);
  if (GetParam() == "virtual") {
    EXPECT_EQ(NumSolved(ours), 0)
        << "the virtual table of a static Ceres can be wrapped after all: change the documentation";
  } else {
    EXPECT_GT(NumSolved(ours), 0) << ours.err;
  }
}

// Among what the loader looks through for a plugin, the program and what was preloaded into it come
// first.
TEST_P(EveryWay, PluginIsCaughtWhereTheProgramIsPreloaded) {
  const ProgramRun stock = AsPlugin(INCERES_PLAIN_PLUGIN, GetParam());
  ASSERT_EQ(stock.exit_code, 0) << stock.err;
  EXPECT_EQ(WithoutTimes(stock.out), WithoutTimes(Bare(GetParam()).out));
  EXPECT_EQ(NumSolved(stock), -1);
  const ProgramRun ours = AsPlugin(INCERES_PLAIN_PLUGIN, GetParam(), "LD_PRELOAD=" INCERES_DROPIN);
  ASSERT_EQ(ours.exit_code, 0) << ours.err;
  EXPECT_EQ(WithoutTimes(ours.out), WithoutTimes(Preloaded(GetParam()).out));
  EXPECT_EQ(NumSolved(ours), NumSolved(Preloaded(GetParam()))) << ours.err;
}

// Nothing is preloaded: the drop-in, and Ceres behind it, are known to the plugin alone.
TEST_P(EveryWay, PluginLinkedInCeresPlaceSolvesAsStockDoes) {
  const ProgramRun ours = AsPlugin(INCERES_LINKED_PLUGIN, GetParam());
  ASSERT_EQ(ours.exit_code, 0) << ours.err;
  EXPECT_EQ(WithoutTimes(ours.out), WithoutTimes(Preloaded(GetParam()).out));
  EXPECT_EQ(NumSolved(ours), NumSolved(Preloaded(GetParam()))) << ours.err;
}

// RTLD_DEEPBIND: the plugin makes its Problem in its own Ceres, past us. When Ceres then passes the
// solve to us we know nothing of that Problem; solved by the member function it does not come to us
// at all. A Problem of the C interface is made inside Ceres, which is bound to us.
TEST_P(EveryWay, PluginBoundToItsOwnCeresFirstIsStocks) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the sanitizers forbid RTLD_DEEPBIND";
#endif
  const ProgramRun run =
      AsPlugin(INCERES_PLAIN_PLUGIN, GetParam(), "LD_PRELOAD=" INCERES_DROPIN, "deep");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  if (GetParam() == "c_api") {
    EXPECT_EQ(NumSolved(run), 1) << run.err;
  } else {
    EXPECT_EQ(WithoutTimes(run.out), WithoutTimes(Bare(GetParam()).out));
    EXPECT_EQ(NumSolved(run), 0) << run.err;
    const bool comes_to_us =
        CountOf(run.err, "handed to stock Ceres: the problem's constructor was not seen") > 0;
    EXPECT_EQ(comes_to_us, GetParam() != "member") << run.err;
  }
}

TEST_P(EveryWay, PluginWithAStaticCeresInsideIsNotSeen) {
  if (INCERES_CERES_IS_STATIC == 0) {
    GTEST_SKIP() << "Ceres::ceres is shared here";
  }
  const ProgramRun stock =
      AsPlugin(INCERES_STATIC_PLUGIN, GetParam(), "LD_PRELOAD=" INCERES_DROPIN);
  ASSERT_EQ(stock.exit_code, 0) << stock.err;
  EXPECT_EQ(WithoutTimes(stock.out), WithoutTimes(Bare(GetParam()).out));
  EXPECT_EQ(stock.err, "inceres solved 0 times\n");
}

TEST_P(EveryWay, StockModeIsIdenticalToStock) {
  const ProgramRun stock = Bare(GetParam());
  for (const ProgramRun& run :
       {Preloaded(GetParam(), "INCERES_MODE=stock"),
        RunProgram(INCERES_LINKED_PROGRAM, GetParam(), "INCERES_MODE=stock")}) {
    EXPECT_EQ(run.exit_code, 0);
    EXPECT_EQ(WithoutTimes(run.out), WithoutTimes(stock.out));
    EXPECT_EQ(run.err, "inceres solved 0 times\n");
  }
}

TEST_P(EveryWay, ComparesAndLogsUnnoticed) {
  const test::TempDir folder;
  const std::string log = folder.File("ab.jsonl");
  const ProgramRun plain = Preloaded(GetParam());
  const ProgramRun checked = Preloaded(GetParam(), "INCERES_CROSS_CHECK=1");
  const ProgramRun logged = Preloaded(GetParam(), "INCERES_AB_LOG=" + log);
  for (const ProgramRun& run : {checked, logged}) {
    EXPECT_EQ(run.exit_code, 0) << run.err;
    EXPECT_EQ(WithoutTimes(run.out), WithoutTimes(plain.out));
    EXPECT_EQ(NumSolved(run), NumSolved(plain));
    EXPECT_EQ(CountOf(run.err, "disagree"), 0) << run.err;
  }
  const std::string lines = test::ReadBytes(log);
  EXPECT_EQ(CountOf(lines, "\n"), NumSolved(plain));
  EXPECT_EQ(CountOf(lines, "\"difference\": null"), CountOf(lines, "has an evaluation callback"))
      << lines;
}

INSTANTIATE_TEST_SUITE_P(Dropin, EveryWay, ::testing::ValuesIn(kWays),
                         [](const auto& way) { return way.param; });

// Loaded for itself alone the plugin is not the only one that may call Ceres.
TEST(Dropin, BoundsSetByWhoeverDoesNotFindItAreHonored) {
  const ProgramRun stock = AsPlugin(INCERES_PLAIN_PLUGIN, "bound_behind");
  const ProgramRun ours = AsPlugin(INCERES_LINKED_PLUGIN, "bound_behind");
  ASSERT_EQ(ours.exit_code, 0) << ours.err;
  EXPECT_EQ(NumSolved(ours), 1) << ours.err;
  ExpectSameOutput(stock.out, ours.out, 1e-9);
  EXPECT_NE(WithoutTimes(ours.out), WithoutTimes(Bare("free").out)) << "no bound was set";
}

// Ours says what is open; stock counts columns.
TEST(Dropin, CovariancesAreOurs) {
  EXPECT_EQ(CountOf(Preloaded("open_covariance").err, "inceres: no covariance: "), 1);
  EXPECT_EQ(CountOf(Bare("open_covariance").err, "Jacobian matrix is rank deficient"), 1);
  EXPECT_EQ(CountOf(Preloaded("open_covariance", "INCERES_MODE=fallback").err, "inceres: no cov"),
            0);
}

TEST(Dropin, ACovarianceThatFailedIsNotTheOneBefore) {
  for (const ProgramRun& run :
       {Bare("covariance_after_failure"), Preloaded("covariance_after_failure")}) {
    EXPECT_NE(run.exit_code, 0);
    EXPECT_EQ(run.out, "1\n1\n0\n");
    EXPECT_EQ(CountOf(run.err, "Covariance::Compute returned false"), 1) << run.err;
  }
}

TEST(Dropin, IncrementalEndsWhereStockEnds) {
  const ProgramRun ours =
      Preloaded("living", "INCERES_MODE=incremental INCERES_WINDOWS=incremental");
  EXPECT_EQ(ours.exit_code, 0);
  EXPECT_EQ(NumSolved(ours), 12) << ours.err;
  EXPECT_EQ(CountOf(ours.err, "not incremental"), 0) << ours.err;
  EXPECT_NE(ours.out, Preloaded("living").out) << "it took exact mode's path";
  ExpectSameOutput(Bare("living").out, ours.out, 1e-5);
}

TEST(Dropin, IncrementalSolvesASlidingWindowExactly) {
  const ProgramRun ours = Preloaded("living", "INCERES_MODE=incremental");
  EXPECT_EQ(ours.out, Preloaded("living").out);
  EXPECT_EQ(NumSolved(ours), 12) << ours.err;
  EXPECT_EQ(CountOf(ours.err, "exact, though asked to be incremental: a window slides, or may"), 1)
      << ours.err;
}

TEST(Dropin, AutoSolvesASlidingWindowExactly) {
  EXPECT_EQ(Preloaded("living", "INCERES_MODE=auto").out, Preloaded("living").out);
}

// What only exact mode does is solved exactly, not by stock.
TEST(Dropin, IncrementalGivesWayToExact) {
  const ProgramRun ours =
      Preloaded("evaluation_callback", "INCERES_MODE=incremental INCERES_WINDOWS=incremental");
  EXPECT_EQ(NumSolved(ours), 1) << ours.err;
  EXPECT_EQ(CountOf(ours.err, "exact, though asked to be incremental: an evaluation callback"), 1)
      << ours.err;
  EXPECT_EQ(ours.out, Preloaded("evaluation_callback").out);
}

TEST(Dropin, ALogTellsOfSessionsAndOfWhatGoesToStock) {
  const test::TempDir folder;
  const std::string log = folder.File("ab.jsonl");
  Preloaded("living", "INCERES_MODE=incremental INCERES_WINDOWS=incremental INCERES_AB_LOG=" + log);
  const std::string sessions = test::ReadBytes(log);
  EXPECT_EQ(CountOf(sessions, "\"mode\": \"incremental\""), 12) << sessions;
  EXPECT_EQ(CountOf(sessions, "\"violations\": []"), 12) << sessions;
  Preloaded("line_search", "INCERES_AB_LOG=" + log);
  EXPECT_EQ(CountOf(test::ReadBytes(log), "\"fallback_reason\": \"minimizer_type LINE_SEARCH\""),
            1);
}

// The final cost that a run has printed last.
double FinalCost(const std::string& out) {
  const std::string arrow = " -> ";
  const std::size_t place = out.rfind(arrow);
  return place == std::string::npos ? -1.0 : std::atof(out.c_str() + place + arrow.size());
}

// Above the size from which on ITERATIVE_SCHUR stands for what is predicted to take least, where a
// factor is dear and blocks take many iterations.
TEST(Dropin, IncrementalSolvesALargeProblemByTwoLevels) {
  const test::TempDir folder;
  const std::string log = folder.File("ab.jsonl");
  const ProgramRun ours = Preloaded("large", "INCERES_MODE=incremental INCERES_AB_LOG=" + log);
  EXPECT_EQ(ours.exit_code, 0);
  EXPECT_EQ(NumSolved(ours), 1) << ours.err;
  const std::string line = test::ReadBytes(log);
  EXPECT_EQ(CountOf(line, "\"mode\": \"incremental\""), 1) << line;
  EXPECT_EQ(CountOf(line, "by products, two-level\""), 1) << line;
  const ProgramRun stock = Bare("large");
  EXPECT_EQ(stock.exit_code, 0);
  EXPECT_GT(FinalCost(stock.out), 0.0) << stock.out;
  EXPECT_GT(FinalCost(ours.out), 0.0) << ours.out;
  EXPECT_LT(FinalCost(ours.out), 1.01 * FinalCost(stock.out));
}

TEST(Dropin, UnknownModeIsSaidOnceAndExactIsUsed) {
  const ProgramRun ours = Preloaded("living", "INCERES_MODE=fast");
  EXPECT_EQ(CountOf(ours.err,
                    "INCERES_MODE: \"fast\" means nothing here and is ignored; known are exact, "
                    "incremental, auto, fallback, stock"),
            1)
      << ours.err;
  EXPECT_EQ(ours.out, Preloaded("living").out);
}

TEST(Dropin, WhatGoesToStockIsStocksAndSaid) {
  const ProgramRun ours = Preloaded("line_search");
  EXPECT_EQ(ours.out, Bare("line_search").out);
  EXPECT_EQ(NumSolved(ours), 0);
  EXPECT_EQ(CountOf(ours.err, "inceres: handed to stock Ceres: minimizer_type LINE_SEARCH"), 1)
      << ours.err;
}

TEST(Dropin, AnotherCeresIsPassedThroughUnread) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "the sanitizers' checks need the types of more of Ceres's classes than the other "
                  "Ceres of this test has";
#endif
  for (const std::string program :
       {INCERES_FOREIGN_SONAME_PROGRAM, INCERES_FOREIGN_FUNCTIONS_PROGRAM}) {
    const ProgramRun bare = RunProgram(program, "", "");
    ASSERT_EQ(bare.exit_code, 0) << bare.err;
    ASSERT_EQ(
        bare.out,
        "problem 1\nresidual block of 3\nfree solve 1\nmember solve\nproblem ends\nreturned\n");
    const ProgramRun ours = RunProgram(program, "", "LD_PRELOAD=" INCERES_DROPIN);
    EXPECT_EQ(ours.exit_code, 0) << ours.err;
    EXPECT_EQ(ours.out, bare.out);
    EXPECT_EQ(CountOf(ours.err, "the drop-in is for Ceres " INCERES_CERES_RELEASE
                                " (" INCERES_CERES_SONAME ") and found "),
              1)
        << ours.err;
    const bool other_soname = program == INCERES_FOREIGN_SONAME_PROGRAM;
    const std::string reason = other_soname ? "SONAME " INCERES_FOREIGN_SONAME
                                            : INCERES_FOREIGN_FUNCTIONS
                                   ", so it is not Ceres " INCERES_CERES_RELEASE;
    EXPECT_NE(ours.err.find("(" + reason + ")"), std::string::npos) << ours.err;
  }
}

// A group other than that of this process which it may give its files to.
std::optional<gid_t> AnotherGroup() {
  constexpr gid_t kNobody = 65534;
  std::vector<gid_t> groups(static_cast<std::size_t>(std::max(0, getgroups(0, nullptr))));
  groups.resize(static_cast<std::size_t>(
      std::max(0, getgroups(static_cast<int>(groups.size()), groups.data()))));
  if (geteuid() == 0) {
    groups.push_back(kNobody);
  }
  const auto other =
      std::find_if(groups.begin(), groups.end(), [](gid_t group) { return group != getgid(); });
  return other == groups.end() ? std::nullopt : std::optional<gid_t>(*other);
}

// A program that runs with rights its user has not: the loader ignores LD_PRELOAD there, and a
// drop-in it is linked with must not do what the environment asks, which could be to write to any
// file.
TEST(Dropin, WithAnothersRightsTheEnvironmentIsIgnored) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the sanitizers need what such a program is refused";
#endif
  const std::optional<gid_t> group = AnotherGroup();
  if (!group) {
    GTEST_SKIP() << "who runs this test is in one group only, so no program of his can be setgid";
  }
  const test::TempDir folder;
  const auto setgid = [&](const std::string& program) {
    const std::string copy = folder.File(std::filesystem::path(program).filename());
    std::filesystem::copy_file(program, copy);
    EXPECT_EQ(chown(copy.c_str(), static_cast<uid_t>(-1), *group), 0);
    EXPECT_EQ(chmod(copy.c_str(), 02755), 0);
    return copy;
  };
  const std::string plain = setgid(INCERES_PLAIN_PROGRAM);
  if (!RunProgram(plain, "free", "LD_PRELOAD=/not/there.so").err.empty()) {
    GTEST_SKIP() << "setgid has no effect here: the loader still looks at LD_PRELOAD";
  }
  const ProgramRun preloaded = RunProgram(plain, "free", "LD_PRELOAD=" INCERES_DROPIN);
  EXPECT_EQ(preloaded.exit_code, 0);
  EXPECT_EQ(preloaded.out, Bare("free").out);
  EXPECT_EQ(preloaded.err, "");

  const std::string log = folder.File("ab.jsonl");
  const ProgramRun linked = RunProgram(setgid(INCERES_LINKED_PROGRAM), "free",
                                       "INCERES_MODE=stock INCERES_AB_LOG=" + log);
  EXPECT_EQ(linked.exit_code, 0) << linked.err;
  EXPECT_EQ(NumSolved(linked), 1) << linked.err;
  EXPECT_FALSE(std::filesystem::exists(log));
}

std::set<std::string> DefinedSymbols(const std::string& library) {
  std::set<std::string> symbols;
  std::istringstream lines(
      RunProgram("nm", "-D --defined-only --format=posix '" + library + "'", "").out);
  for (std::string line; std::getline(lines, line);) {
    symbols.insert(line.substr(0, line.find_first_of(" @")));
  }
  return symbols;
}

// Both ways of solving, all of Covariance, and whatever makes, changes or ends a Problem; neither
// Evaluate does, nor what 2.2 shows of its inside.
TEST(Dropin, ExportsWhatChangesAProblemAndNothingElse) {
  std::set<std::string> expected = {
      "_ZN5ceres5SolveERKNS_6Solver7OptionsEPNS_7ProblemEPNS0_7SummaryE",
      "_ZN5ceres6Solver5SolveERKNS0_7OptionsEPNS_7ProblemEPNS0_7SummaryE",
      "inceres_dropin_is_active", "inceres_dropin_num_problems", "inceres_dropin_num_solves"};
  for (const std::string& symbol : DefinedSymbols(INCERES_SHARED_CERES)) {
    if (symbol.rfind("_ZN5ceres7Problem", 0) == 0 &&
        symbol.rfind("_ZN5ceres7Problem8Evaluate", 0) != 0 &&
        symbol != "_ZN5ceres7Problem12mutable_implEv") {
      expected.insert(symbol);
    }
    if (symbol.find("5ceres10Covariance") != std::string::npos) {
      expected.insert(symbol);
    }
  }
  const std::string release = INCERES_CERES_RELEASE;
  EXPECT_EQ(expected.size(), release == "2.1" ? 37u : 35u)
      << "2.1 alone has both kinds of manifold";
  EXPECT_EQ(DefinedSymbols(INCERES_DROPIN), expected);
}

}  // namespace
}  // namespace inceres::testing
