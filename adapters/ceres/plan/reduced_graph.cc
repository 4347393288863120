#include "adapters/ceres/plan/reduced_graph.h"

#include <algorithm>
#include <numeric>

#include "src/linear/pattern_rows.h"

namespace inceres::internal {
namespace {

constexpr int kSamples = 64;
constexpr int kEverywhere = 4;  // a frame in one clique of so many counts as being everywhere

}  // namespace

ReducedGraph::ReducedGraph(const ProblemView& view, const std::vector<char>& is_landmark)
    : frames_size_(view.blocks.size(), 0.0) {
  NumberFrames(view, is_landmark);
  clique_begin_.push_back(0);
  std::vector<int> landmark_of(view.residuals.size(), -1);
  for (const int r : view.moving) {
    const ResidualBlockView& residual = view.residuals[At(r)];
    const int s = view.FindSlot(residual, [&](int b) { return is_landmark[At(b)] != 0; });
    if (s >= 0) {
      landmark_of[At(r)] = view.SlotsOf(residual)[s];
    } else if (!residual.like_previous) {
      AddToClique(view, residual);
      EndClique();
    }
  }
  const CompressedRows residuals = SortIntoRows(view.blocks.size(), landmark_of);
  for (int b = 0; b < static_cast<int>(view.blocks.size()); ++b) {
    if (residuals[b].size() > 0) {
      AddCliqueOfLandmark(view, residuals[b], b);
    }
  }
  IndexCliques();
}

void ReducedGraph::NumberFrames(const ProblemView& view, const std::vector<char>& is_landmark) {
  frame_of_.assign(view.blocks.size(), -1);
  offsets_.push_back(0);
  for (const int r : view.moving) {
    const ResidualBlockView& residual = view.residuals[At(r)];
    for (int s = 0; !residual.like_previous && s < residual.num_slots; ++s) {
      const int b = view.SlotsOf(residual)[s];
      if (frame_of_[At(b)] < 0 && view.IsReduced(b) && is_landmark[At(b)] == 0) {
        frame_of_[At(b)] = num_frames();
        offsets_.push_back(offsets_.back() + view.block(b).tangent_size);
      }
    }
  }
  seen_in_.assign(At(num_frames()), -1);
}

void ReducedGraph::AddCliqueOfLandmark(const ProblemView& view,
                                       const CompressedRows::Row& residuals, int landmark) {
  for (const int r : residuals) {
    AddToClique(view, view.residuals[At(r)]);
  }
  const double pairs_before = num_pairs_;
  const double size = EndClique();
  num_landmark_pairs_ += num_pairs_ - pairs_before;
  frames_size_[At(landmark)] = size;
  elimination_flops_ += view.block(landmark).tangent_size * size * size;
  largest_clique_ = std::max(largest_clique_, size);
}

void ReducedGraph::AddToClique(const ProblemView& view, const ResidualBlockView& residual) {
  const int clique = static_cast<int>(clique_begin_.size());
  for (int s = 0; s < residual.num_slots; ++s) {
    const int frame = frame_of_[At(view.SlotsOf(residual)[s])];
    if (frame >= 0 && seen_in_[At(frame)] != clique) {
      seen_in_[At(frame)] = clique;
      members_.push_back(frame);
    }
  }
}

// The clique's scalar unknowns.
double ReducedGraph::EndClique() {
  double size = 0.0;
  for (std::size_t k = At(clique_begin_.back()); k < members_.size(); ++k) {
    size += SizeOf(members_[k]);
  }
  const double count = static_cast<double>(members_.size()) - clique_begin_.back();
  num_pairs_ += 0.5 * count * (count + 1.0);
  clique_begin_.push_back(static_cast<int>(members_.size()));
  return size;
}

void ReducedGraph::IndexCliques() {
  cliques_of_ = SortIntoRows(At(num_frames()), [this](const auto& add) {
    for (std::size_t clique = 0; clique + 1 < clique_begin_.size(); ++clique) {
      for (int k = clique_begin_[clique]; k < clique_begin_[clique + 1]; ++k) {
        add(members_[At(k)], static_cast<int>(clique));
      }
    }
  });
}

ReducedGraph::Envelope ReducedGraph::EnvelopeOfAppearance() const {
  const int limit = static_cast<int>(clique_begin_.size() - 1) / kEverywhere;
  std::vector<int> first(At(num_frames()));
  std::iota(first.begin(), first.end(), 0);
  const auto is_everywhere = [&](int frame) { return cliques_of_[frame].size() > limit; };
  for (std::size_t clique = 0; clique + 1 < clique_begin_.size(); ++clique) {
    int lowest = num_frames();
    for (int k = clique_begin_[clique]; k < clique_begin_[clique + 1]; ++k) {
      const int frame = members_[At(k)];
      lowest = is_everywhere(frame) ? lowest : std::min(lowest, frame);
    }
    for (int k = clique_begin_[clique]; k < clique_begin_[clique + 1]; ++k) {
      first[At(members_[At(k)])] = std::min(first[At(members_[At(k)])], lowest);
    }
  }
  Envelope envelope;
  double everywhere = 0.0;  // scalar unknowns
  for (int frame = 0; frame < num_frames(); ++frame) {
    if (is_everywhere(frame)) {
      everywhere += SizeOf(frame);
      continue;
    }
    const double width = offsets_[At(frame) + 1] - offsets_[At(first[At(frame)])];
    envelope.flops += SizeOf(frame) * width * width;
    envelope.entries += SizeOf(frame) * width;
  }
  // Their rows are full, and each entry takes the row of its column.
  envelope.flops += everywhere * (2.0 * envelope.entries + everywhere * size());
  envelope.entries += everywhere * size();
  return envelope;
}

template <typename Visit>
void ReducedGraph::ForEachNeighbor(int frame, int last, std::vector<int>* seen,
                                   const Visit& visit) const {
  int left = last + 1;  // frames up to `last` that are not seen yet
  const auto see = [&](int other) {
    if (other <= last && (*seen)[At(other)] != frame) {
      (*seen)[At(other)] = frame;
      visit(other);
      --left;
    }
  };
  see(frame);
  for (const int clique : cliques_of_[frame]) {
    if (left == 0) {
      return;
    }
    std::for_each(members_.begin() + clique_begin_[At(clique)],
                  members_.begin() + clique_begin_[At(clique) + 1], see);
  }
}

double ReducedGraph::SampleFill() const {
  std::vector<int> seen(At(num_frames()), -1);
  const int stride = std::max(1, num_frames() / kSamples);
  double filled = 0.0;
  double all = 0.0;
  for (int frame = 0; frame < num_frames(); frame += stride) {
    ForEachNeighbor(frame, num_frames() - 1, &seen, [&](int other) {
      filled += static_cast<double>(SizeOf(frame)) * SizeOf(other);
    });
    all += SizeOf(frame) * size();
  }
  return all > 0.0 ? filled / all : 0.0;
}

BlockPattern ReducedGraph::Pattern() const {
  BlockPattern pattern = PatternWithoutBlocks(offsets_);
  std::vector<int> seen(At(num_frames()), -1);
  std::vector<int> columns;
  for (int row = 0; row < num_frames(); ++row) {
    columns.clear();
    ForEachNeighbor(row, row, &seen, [&](int column) { columns.push_back(column); });
    std::sort(columns.begin(), columns.end());
    AppendRow(columns, &pattern);
  }
  return pattern;
}

}  // namespace inceres::internal
