#include <petsclog.h>

#include <algorithm>

#include <sys/resource.h>

#include "distributed/solve_steps.h"

namespace inceres::internal {

// What the summary tells of the parts: sizes of all together, and what each rank had to do and to
// send. Counters run from TrafficCounter's making, after set-up, so the differences are those of
// the loop.
//
// Exchanges of frames are counted by PETSc, for the whole process; gatherings, and what goes to the
// owners of blocks of S and of rows, by Communicator.
// exchange_bytes_per_product is not counted but follows from the plan.

namespace {

// Counted by PETSc of all messages it sends, unless it was built without logging.
// Bytes of messages from one rank to another, sent with and without waiting. PETSc has them as
// doubles.
double PetscBytesSent() {
#if defined(PETSC_USE_LOG)
  return static_cast<double>(petsc_isend_len) + static_cast<double>(petsc_send_len);
#else
  return 0.0;
#endif
}

std::int64_t PeakResidentBytes() {
  rusage usage{};
  // Linux gives kilobytes.
  return getrusage(RUSAGE_SELF, &usage) == 0 ? std::int64_t{usage.ru_maxrss} * 1024 : 0;
}

// What is thrown is dropped: the message is that of the first time.
template <typename Evaluate>
bool Throws(const Evaluate& evaluate) {
  try {
    evaluate();
  } catch (...) {
    return true;
  }
  return false;
}

}  // namespace

// Collective. Variables, values, factors and residuals are of all graphs, so a frame counts for
// each rank that lists it. What moves counts once: landmarks are summed over ranks, frames come
// from SharedFrames, which has them once. Sums of counts are exact in doubles below 2⁵³.
void SumSizes(const Communicator& ranks, const FactorGraph& graph, const Layout& layout,
              const SharedFrames& frames, ProblemSizes* sizes) {
  std::int64_t num_values = 0;
  std::int64_t num_residuals = 0;
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    num_values += graph.HasVariable(id) ? graph.AmbientSize(id) : 0;
  }
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    // Places of removed factors stay in a family, and have no residuals.
    num_residuals += std::int64_t{graph.NumFactors(id) - graph.NumFreePlaces(id)} *
                     graph.family(id).residual_size();
  }
  double landmark_values = 0.0;
  for (std::size_t i = static_cast<std::size_t>(layout.num_frames); i < layout.variables.size();
       ++i) {
    landmark_values += graph.AmbientSize(layout.variables[i]);
  }
  double sums[6] = {static_cast<double>(graph.num_live_variables()),
                    static_cast<double>(num_values),
                    static_cast<double>(graph.num_factors()),
                    static_cast<double>(num_residuals),
                    static_cast<double>(layout.num_landmarks()),
                    static_cast<double>(layout.size() - layout.frame_size())};
  ranks.SumAll(6, sums);
  landmark_values = ranks.Sum(landmark_values);
  sizes->num_variables = SaturatedCount(sums[0]);
  sizes->num_values = SaturatedCount(sums[1]);
  sizes->num_factors = SaturatedCount(sums[2]);
  sizes->num_residuals = static_cast<std::int64_t>(sums[3]);
  sizes->num_moving_variables = SaturatedCount(sums[4] + static_cast<double>(frames.num_frames()));
  sizes->num_moving_values = SaturatedCount(
      landmark_values + static_cast<double>(frames.total_size(FramePlace::kAmbient)));
  sizes->num_dimensions =
      SaturatedCount(sums[5] + static_cast<double>(frames.total_size(FramePlace::kTangent)));
}

// PETSc's counters are of the process and never reset; the communicator's are of all solves with
// it.
TrafficCounter::TrafficCounter(const Communicator& ranks)
    : ranks_(ranks),
      petsc_bytes_(PetscBytesSent()),
      messages_(ranks.messages()),
      reductions_(ranks.reductions()) {
}

RankReport TrafficCounter::Report(const FactorGraph& graph, const Layout& layout,
                                  const SharedFrames& frames, const DistributedModel& model) const {
  RankReport report;
  report.num_factors = graph.num_factors();
  report.num_landmarks = layout.num_landmarks();
  report.num_frames = layout.num_frames;
  report.num_owned_frames = static_cast<std::int64_t>(frames.owned().size());
  for (const FramePlace& place : frames.moving()) {
    // What exchange_bytes_per_product compares with: values of the frames that others have too,
    // once.
    if (place.num_others > 0) {
      ++report.num_shared_frames;
      report.shared_frame_bytes +=
          static_cast<std::int64_t>(sizeof(double)) * place.sizes[FramePlace::kTangent];
    }
  }
  report.peak_resident_bytes = PeakResidentBytes();
  report.exchange_bytes_per_product = model.exchange().bytes_per_round();
  report.num_products = model.num_products();
  report.bytes_sent = static_cast<std::int64_t>(PetscBytesSent() - petsc_bytes_) +
                      ranks_.messages().bytes - messages_.bytes;
  report.reduction_bytes_sent = ranks_.reductions().bytes - reductions_.bytes;
  report.product_seconds = model.product_seconds();
  report.exchange_seconds =
      model.exchange().seconds() + ranks_.messages().seconds - messages_.seconds;
  report.reduction_seconds = ranks_.reductions().seconds - reductions_.seconds;
  return report;
}

void GatherReports(const Communicator& ranks, const RankReport& own, DistributedSummary* summary) {
  summary->ranks = ranks.GatherAll(std::vector<RankReport>{own});
  std::int64_t total = 0;
  std::int64_t largest = 0;
  for (const RankReport& report : summary->ranks) {
    total += report.num_factors;
    largest = std::max(largest, report.num_factors);
  }
  // Largest over mean.
  if (total > 0) {
    summary->imbalance = static_cast<double>(largest) * ranks.size() / static_cast<double>(total);
  }
}

// Finds the factor behind an exception, after the fact: one factor at a time is evaluated until one
// throws again. Costs an evaluation of all factors in the worst case, and is not collective. A
// factor that counts its calls may not throw a second time.
//
// Residuals at the candidate come first, then residuals and Jacobians at the current point;
// families in their order, factors by place. Writes into the caches, which the end of the solve
// makes worthless.
std::string DescribeThrower(Evaluator* evaluator) {
  const FactorGraph& graph = evaluator->graph();
  for (Linearization& cache : evaluator->families()) {
    for (int i = 0; i < cache.num_factors; ++i) {
      if (graph.HasFactor(cache.id, i) && (Throws([&] { cache.EvaluateCandidate(i, i + 1); }) ||
                                           Throws([&] { cache.Linearize(i, i + 1); }))) {
        return graph.DescribeFactor(cache.id, i);
      }
    }
  }
  return "a factor that did not throw again";
}

}  // namespace inceres::internal
