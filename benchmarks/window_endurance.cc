// Ten thousand frames of the visual-inertial window: does a late frame cost what an early one did,
// and is the trajectory as good as with stock Ceres on the same factors? `--help` says how.

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <ceres/ceres.h>
#include <gflags/gflags.h>

#include "estimator/window.h"
#include "estimator/window_sequence.h"
#include "inceres/estimator/trajectory_error.h"
#include "tools/command_line/command_line.h"
#include "tools/command_line/heartbeat.h"
#include "tools/command_line/output.h"
#include "tools/problems/factor_cost_function.h"

DEFINE_int32(frames, 10000, "camera frames, ten a second; 3000 or more");
DEFINE_int32(points, 20000, "points along the way");
DEFINE_bool(stock, true,
            "plays the same with stock Ceres (DENSE_SCHUR, Dog-Leg) in the place of our solver");
DEFINE_bool(first_estimates, false, "first-estimate Jacobians, in ours");

namespace {

using inceres::FactorFamily;
using inceres::FactorGraph;
using inceres::FactorId;
using inceres::FamilyId;
using inceres::Status;
using inceres::StatusCode;
using inceres::VariableId;
using inceres::internal::Window;

const inceres::tools::ToolHelp kHelp = {
    "Play a long simulated sequence, frame by frame, with ours and stock, and print its cost.",
    "Thread CPU time a frame (median of frames 1,000 to 2,000 and of the last 1,000, 99th "
    "percentile), memory, and the absolute trajectory error. Exit code 1 as well if a frame fails.",
    {{"a quarter of an hour's sequence", "window_endurance --frames 10000"}}};

// A factor of a living graph as a cost function, tangent Jacobians in the leading columns as in
// FactorCostFunction: blocks with a manifold need PoseBlockManifold.
class GraphFactor final : public ceres::CostFunction {
 public:
  // Tables that the factors of one problem share, by place, as families read them; so they must not
  // be evaluated at one time.
  struct Tables {
    std::vector<const double*> parameters;
    std::vector<const inceres::TangentMap*> maps;
    std::vector<double> residuals;
  };

  GraphFactor(const FactorFamily& family, int index, Tables* tables)
      : family_(family), index_(index), tables_(tables) {
    set_num_residuals(family.residual_size());
    for (int s = 0; s < family.num_slots(); ++s) {
      mutable_parameter_block_sizes()->push_back(family.slot(s).ambient_size);
    }
    const std::size_t places = Index(index) + 1, slots = Index(family.num_slots());
    tables->parameters.resize(std::max(tables->parameters.size(), places * slots));
    tables->maps.resize(tables->parameters.size());
    tables->residuals.resize(
        std::max(tables->residuals.size(), places * Index(family.residual_size())));
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    static const inceres::TangentMap kConstant{inceres::TangentMap::Kind::kConstant, 0, 0, nullptr,
                                               nullptr};
    static const int kColumns[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    const auto slots = Index(family_.num_slots());
    std::vector<inceres::TangentMap> maps(slots);
    std::vector<inceres::JacobianView> views(slots);
    for (std::size_t s = 0; s < slots; ++s) {
      const FactorFamily::Slot slot = family_.slot(static_cast<int>(s));
      const std::size_t at = Index(index_) * slots + s;
      tables_->parameters[at] = parameters[s];
      maps[s].ambient_size = slot.ambient_size;
      maps[s].tangent_size = slot.tangent_size;
      if (slot.tangent_size < slot.ambient_size) {
        maps[s].kind = inceres::TangentMap::Kind::kSelection;
        maps[s].selection = kColumns;
      }
      const bool wanted = jacobians != nullptr && jacobians[s] != nullptr;
      tables_->maps[at] = wanted ? &maps[s] : &kConstant;
      if (wanted) {
        std::fill_n(jacobians[s], num_residuals() * slot.ambient_size, 0.0);
        views[s] = {jacobians[s], 0, slot.ambient_size};
      }
    }
    inceres::FactorBatch batch;
    batch.begin = index_;
    batch.end = index_ + 1;
    batch.parameters = tables_->parameters.data();
    batch.residuals = tables_->residuals.data();
    if (jacobians != nullptr) {
      batch.tangent_maps = tables_->maps.data();
      batch.jacobians = views.data();
    }
    const bool failed = family_.Evaluate(batch).failed();
    std::copy_n(tables_->residuals.data() + Index(index_) * Index(num_residuals()), num_residuals(),
                residuals);
    return !failed;
  }

 private:
  static std::size_t Index(int i) { return static_cast<std::size_t>(i); }

  const FactorFamily& family_;
  const int index_;
  Tables* tables_;
};

class CeresLoss final : public ceres::LossFunction {
 public:
  explicit CeresLoss(const inceres::Loss& loss) : loss_(loss) {}
  void Evaluate(double s, double rho[3]) const override { loss_.Evaluate(s, rho); }

 private:
  const inceres::Loss& loss_;
};

// Minimizes the window's graph by stock Ceres and puts the result back.
Status SolveByStock(Window* window) {
  inceres::IncrementalSolver& solver = window->mutable_graph().solver;
  const FactorGraph& graph = solver.graph();
  std::map<VariableId, std::vector<double>> values;
  GraphFactor::Tables tables;
  ceres::Problem problem;
  for (FamilyId family = 0; family < graph.num_families(); ++family) {
    for (int i = 0; i < graph.NumFactors(family); ++i) {
      std::vector<double*> blocks;
      for (int s = 0; graph.HasFactor(family, i) && s < graph.family(family).num_slots(); ++s) {
        const VariableId id = graph.Variables(family, i)[s];
        std::vector<double>& x = values[id];
        if (x.empty()) {
          const int size = graph.AmbientSize(id);
          x.assign(solver.Values(id), solver.Values(id) + size);
          problem.AddParameterBlock(x.data(), size,
                                    size == 7 ? new inceres::tools::PoseBlockManifold : nullptr);
          if (graph.IsConstant(id)) {
            problem.SetParameterBlockConstant(x.data());
          }
        }
        blocks.push_back(x.data());
      }
      if (!blocks.empty()) {
        const inceres::Loss* loss = graph.loss(family, i);
        problem.AddResidualBlock(new GraphFactor(graph.family(family), i, &tables),
                                 loss == nullptr ? nullptr : new CeresLoss(*loss), blocks);
      }
    }
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.max_num_iterations = inceres::SlidingWindowOptions().solver.max_num_iterations;
  options.function_tolerance = inceres::SlidingWindowOptions().solver.function_tolerance;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) {
    return Status::Error(StatusCode::kSingular, "stock: " + summary.message);
  }
  inceres::GraphEdit edit(graph);
  for (const auto& [id, x] : values) {
    if (!graph.IsConstant(id)) {
      edit.SetValues(id, x.data());
    }
  }
  return solver.Apply(edit);
}

double ThreadMilliseconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

double ResidentMegabytes() {
  std::ifstream file("/proc/self/statm");
  double total = 0.0, resident = 0.0;
  file >> total >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1048576.0;
}

struct Play {
  std::vector<double> milliseconds;  // of thread CPU time, a frame
  std::vector<double> evaluations;   // of factors
  std::vector<double> landmarks;
  inceres::Trajectory estimate, truth;
  double early_megabytes = 0.0, late_megabytes = 0.0;  // resident, at frame 2,000 and at the end
};

// A window on the sequence, frame by frame.
class Player {
 public:
  Player(const inceres::VioSequence& sequence, bool stock)
      : sequence_(sequence), stock_(stock), window_(Options(sequence, stock)) {}

  Status Start() {
    inceres::test::Random random(1);
    return window_.Start(inceres::test::DrawnStart(sequence_, &random, inceres::test::GoodStart()),
                         inceres::test::WindowFrameOf(sequence_, 0).observations);
  }

  Status PlayTo(std::size_t end) {
    Status status;
    while (status.ok() && next_ < end) {
      status = Step();
    }
    return status;
  }

  Status Step() {
    const inceres::WindowFrame frame = inceres::test::WindowFrameOf(sequence_, next_);
    inceres::WindowSummary summary;
    const double begin = ThreadMilliseconds();
    Status status = window_.Admit(frame, &summary);
    status = status.ok() && stock_ ? SolveByStock(&window_) : status;
    // Behind stock's, ours takes no step, and is no part of stock's time.
    const double own_begin = ThreadMilliseconds();
    status = status.ok() ? window_.Solve(&summary) : status;
    const double own = stock_ ? ThreadMilliseconds() - own_begin : 0.0;
    const inceres::WindowState state = window_.graph().StateOf(window_.frames().back());
    status = status.ok() ? window_.Slide(&summary) : status;
    play_.milliseconds.push_back(ThreadMilliseconds() - begin - own);
    play_.evaluations.push_back(static_cast<double>(summary.update.num_evaluated_factors));
    play_.landmarks.push_back(window_.tracks().CountLandmarks());
    play_.estimate.push_back(state.pose);
    play_.truth.push_back(sequence_.frames[next_].truth.pose);
    if (!status.ok()) {
      status.message = "frame " + std::to_string(next_) + ": " + status.message;
    }
    ++next_;
    play_.early_megabytes = next_ == 2000 ? ResidentMegabytes() : play_.early_megabytes;
    play_.late_megabytes =
        next_ == sequence_.frames.size() ? ResidentMegabytes() : play_.late_megabytes;
    return status;
  }

  const Play& play() const { return play_; }

 private:
  static inceres::SlidingWindowOptions Options(const inceres::VioSequence& sequence, bool stock) {
    inceres::SlidingWindowOptions options = inceres::test::WindowOptionsOf(sequence);
    options.marginalization.first_estimate_jacobians = !stock && FLAGS_first_estimates;
    options.solver.max_num_iterations = stock ? 0 : options.solver.max_num_iterations;
    return options;
  }

  const inceres::VioSequence& sequence_;
  const bool stock_;
  Window window_;
  std::size_t next_ = 1;
  Play play_;
};

// Of the values [begin, end), the one below which this share lies.
double Quantile(const std::vector<double>& all, std::size_t begin, std::size_t end, double share) {
  std::vector<double> values(all.begin() + static_cast<std::ptrdiff_t>(begin),
                             all.begin() + static_cast<std::ptrdiff_t>(end));
  const auto at = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<std::size_t>(at)];
}

using inceres::tools::Out;

void PrintRow(const char* what, const std::vector<double>& early, const std::vector<double>& late) {
  const std::size_t end = late.size();
  const double before = Quantile(early, 1000, 2000, 0.5),
               after = Quantile(late, end - 1000, end, 0.5);
  const double median = Quantile(late, 0, end, 0.5), p99 = Quantile(late, 0, end, 0.99);
  std::fprintf(
      Out(),
      "  %-18s median %.4g at frames 1,000 to 2,000, %.4g in the last 1,000: %+.1f %%; all: median "
      "%.4g, p99 %.4g = %.2f\n",
      what, before, after, 100.0 * (after / before - 1.0), median, p99, p99 / median);
}

void Print(const char* name, const Play& early, const Play& late) {
  std::fprintf(Out(), "%s\n", name);
  PrintRow("CPU, ms", early.milliseconds, late.milliseconds);
  if (Quantile(late.evaluations, 0, late.evaluations.size(), 0.5) > 0.0) {
    PrintRow("evaluated factors", early.evaluations, late.evaluations);
  }
  PrintRow("landmarks", early.landmarks, late.landmarks);
  std::fprintf(Out(), "  memory             %.1f MB at frame 2,000, %.1f MB at the end\n",
               late.early_megabytes, late.late_megabytes);
  std::fprintf(Out(), "  ATE                %.4g m; RPE over 1 m %.4g m\n",
               inceres::AbsoluteTrajectoryError(late.estimate, late.truth),
               inceres::RelativePoseErrorOverPath(late.estimate, late.truth, 1.0).translation);
}

// All frames; the last 1,000 in turn with frames 1,000 to 2,000 of a window begun anew, so that
// whatever else the machine does slows both.
Status PlayAndPrint(const inceres::VioSequence& sequence, bool stock) {
  const inceres::tools::Heartbeat heartbeat(inceres::tools::ProgressOutput(),
                                            stock ? "playing stock" : "playing ours");
  Player all(sequence, stock), young(sequence, stock);
  Status status = all.Start();
  status = status.ok() ? all.PlayTo(sequence.frames.size() - 1000) : status;
  status = status.ok() ? young.Start() : status;
  status = status.ok() ? young.PlayTo(1001) : status;
  for (int k = 0; status.ok() && k < 1000; ++k) {
    status = all.Step();
    status = status.ok() ? young.Step() : status;
  }
  if (status.ok()) {
    Print(stock ? "stock Ceres, " CERES_VERSION_STRING : "inceres", young.play(), all.play());
    std::fflush(Out());
  }
  return status;
}

Status Run() {
  if (FLAGS_frames < 3000) {
    return Status::Error(StatusCode::kInvalidArgument, "--frames must be 3000 or more");
  }
  inceres::VioSceneOptions scene;
  scene.num_frames = FLAGS_frames;
  scene.num_points = FLAGS_points;
  scene.max_track_length = 40;
  scene.loop_fraction = 0.0;
  inceres::VioSequence sequence;
  Status status = inceres::GenerateVioScene(scene, &sequence);
  status = status.ok() ? PlayAndPrint(sequence, false) : status;
  return status.ok() && FLAGS_stock ? PlayAndPrint(sequence, true) : status;
}

}  // namespace

int main(int argc, char** argv) {
  return inceres::tools::RunTool(kHelp, argc, argv, Run);
}
