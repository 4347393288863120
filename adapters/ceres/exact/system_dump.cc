#include "adapters/ceres/exact/system_dump.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <fstream>
#include <functional>
#include <iterator>

#include <Eigen/Core>
#include <glog/logging.h>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/read/index.h"
#include "src/base/formatted.h"

namespace inceres::internal {
namespace {

// line_of(k) of each k, with its line end. Whether all was written.
template <typename LineOf>
bool WriteLines(const std::string& path, std::size_t count, const LineOf& line_of) {
  std::ofstream file(path);
  for (std::size_t k = 0; file.good() && k < count; ++k) {
    file << line_of(k);
  }
  file.close();
  return file.good();
}

bool WriteVector(const std::string& path, const std::vector<double>& values) {
  return WriteLines(path, values.size(),
                    [&](std::size_t k) { return Formatted("%17f\n", values[k]); });
}

std::string LoadLine(const char* name, const std::string& path) {
  return std::string("lsqp.") + name + " = load('" + path + "', '-ascii');\n";
}

std::string BaseName(const std::string& directory, int iteration) {
  const bool joins = directory.empty() || directory.back() == '/';
  return directory + (joins ? "" : "/") + Formatted("ceres_solver_iteration_%03d", iteration);
}

// In the order that they have.
void PutEliminatedFirst(const LandmarkSelection& landmarks, std::vector<int>* blocks) {
  const LandmarkSelection eliminated = WithLarge(landmarks);
  std::stable_partition(blocks->begin(), blocks->end(),
                        [&](int b) { return eliminated.Contains(b); });
}

Eigen::Map<const Eigen::VectorXd> AsEigen(const std::vector<double>& values) {
  return {values.data(), static_cast<Eigen::Index>(values.size())};
}

}  // namespace

SystemDump::SystemDump(const ceres::Solver::Options& options, const ProblemView& view,
                       const GraphPlan& plan, ceres::LinearSolverType type)
    : iterations_(options.trust_region_minimizer_iterations_to_dump),
      directory_(options.trust_region_problem_dump_directory),
      to_log_(options.trust_region_problem_dump_format_type == ceres::CONSOLE),
      dense_(type == ceres::DENSE_QR || type == ceres::DENSE_NORMAL_CHOLESKY),
      leaves_out_zeros_(options.dynamic_sparsity && type == ceres::SPARSE_NORMAL_CHOLESKY) {
  std::sort(iterations_.begin(), iterations_.end());
  std::vector<int> first_row(view.residuals.size(), -1);
  std::vector<char> placed(view.blocks.size(), 0);
  std::vector<int> order;  // of blocks
  for (const int r : view.moving) {
    const ResidualBlockView& residual = view.residuals[At(r)];
    first_row[At(r)] = num_rows_;
    num_rows_ += residual.num_residuals;
    for (int s = 0; s < residual.num_slots; ++s) {
      const int b = view.SlotsOf(residual)[s];
      if (view.IsReduced(b) && placed[At(b)] == 0) {
        placed[At(b)] = 1;
        order.push_back(b);
      }
    }
  }
  if (IsSchurType(type)) {
    PutEliminatedFirst(plan.landmarks, &order);
  }
  std::vector<VariableId> variables(view.blocks.size(), -1);
  for (std::size_t id = 0; id < plan.blocks.size(); ++id) {
    variables[At(plan.blocks[id])] = static_cast<VariableId>(id);
  }
  first_column_.assign(plan.blocks.size(), -1);
  for (const int b : order) {
    columns_.push_back({variables[At(b)], view.block(b).tangent_size});
    first_column_[At(columns_.back().variable)] = num_columns_;
    num_columns_ += view.block(b).tangent_size;
  }
  for (const GraphPlan::Family& family : plan.families) {
    num_rows_of_.push_back(family.shape.num_residuals);
    std::vector<int>& rows = first_row_.emplace_back();
    std::transform(family.residuals.begin(), family.residuals.end(), std::back_inserter(rows),
                   [&](int residual) { return first_row[At(residual)]; });
  }
}

bool SystemDump::Wants(int iteration) const {
  return std::binary_search(iterations_.begin(), iterations_.end(), iteration);
}

void SystemDump::See(const StepSystem& system) {
  const std::vector<Entry> J = JacobianOf(system);
  std::vector<double> damping = system.damping;
  std::transform(damping.begin(), damping.end(), damping.begin(),
                 [](double entry) { return std::sqrt(entry); });
  const std::vector<double> D = InColumnOrder(system, damping, std::multiplies<>());
  const std::vector<double> x = InColumnOrder(system, system.solution, std::divides<>());
  const std::vector<double> b = ResidualsOf(system);
  if (to_log_) {
    WriteToLog(J, D, b, x);
    return;
  }
  const std::string base = BaseName(directory_, system.iteration);
  LOG(INFO) << "writing to: " << base << "*";
  LOG_IF(ERROR, !WriteFiles(base, dense_ ? AllEntries(J) : J, D, b, x))
      << "Unable to dump trust region problem. Filename base: " << base;
}

// Scaled, block by block.
std::vector<SystemDump::Entry> SystemDump::JacobianOf(const StepSystem& system) const {
  std::vector<const StepSystem::Block*> blocks;
  for (const StepSystem::Block& block : system.blocks) {
    blocks.push_back(&block);
  }
  const auto row_of = [this](const StepSystem::Block& block) {
    return first_row_[At(block.family)][At(block.factor)];
  };
  std::stable_sort(blocks.begin(), blocks.end(),
                   [&](const auto* a, const auto* b) { return row_of(*a) < row_of(*b); });
  std::vector<Entry> entries;
  for (const StepSystem::Block* block : blocks) {
    const int column = first_column_[At(block->variable)];
    const int scale = system.first_entry[At(block->variable)];
    for (int r = 0; r < block->rows; ++r) {
      for (int c = 0; c < block->columns; ++c) {
        const double value = block->values[static_cast<std::ptrdiff_t>(r) * block->row_stride + c];
        if (value != 0.0 || !leaves_out_zeros_) {
          entries.push_back({row_of(*block) + r, column + c, value * system.scale[At(scale + c)]});
        }
      }
    }
  }
  return entries;
}

// Row by row, zeros too.
std::vector<SystemDump::Entry> SystemDump::AllEntries(const std::vector<Entry>& entries) const {
  std::vector<Entry> all;
  all.reserve(At(num_rows_) * At(num_columns_));
  for (int r = 0; r < num_rows_; ++r) {
    for (int c = 0; c < num_columns_; ++c) {
      all.push_back({r, c, 0.0});
    }
  }
  for (const Entry& entry : entries) {
    all[At(entry.row) * At(num_columns_) + At(entry.column)].value = entry.value;
  }
  return all;
}

std::vector<double> SystemDump::ResidualsOf(const StepSystem& system) const {
  std::vector<double> b(At(num_rows_));
  for (std::size_t f = 0; f < first_row_.size(); ++f) {
    const double* residual = system.residuals[f].data();
    for (const int row : first_row_[f]) {
      std::copy_n(residual, num_rows_of_[f], b.begin() + row);
      residual += num_rows_of_[f];
    }
  }
  return b;
}

// scale(value, scale of its column) of each value.
template <typename Scale>
std::vector<double> SystemDump::InColumnOrder(const StepSystem& system,
                                              const std::vector<double>& values,
                                              const Scale& scale) const {
  std::vector<double> result;
  result.reserve(At(num_columns_));
  for (const Columns& columns : columns_) {
    const int first = system.first_entry[At(columns.variable)];
    for (int k = first; k < first + columns.count; ++k) {
      result.push_back(scale(values[At(k)], system.scale[At(k)]));
    }
  }
  return result;
}

void SystemDump::WriteToLog(const std::vector<Entry>& A, const std::vector<double>& D,
                            const std::vector<double>& b, const std::vector<double>& x) const {
  Eigen::MatrixXd transposed = Eigen::MatrixXd::Zero(num_columns_, num_rows_);
  for (const Entry& entry : A) {
    transposed(entry.column, entry.row) = entry.value;
  }
  LOG(INFO) << "A^T: \n" << transposed;
  LOG(INFO) << "A's appended diagonal:\n" << AsEigen(D);
  LOG(INFO) << "b: \n" << AsEigen(b);
  LOG(INFO) << "x: \n" << AsEigen(x);
}

bool SystemDump::WriteFiles(const std::string& base, const std::vector<Entry>& A,
                            const std::vector<double>& D, const std::vector<double>& b,
                            const std::vector<double>& x) const {
  const std::string path = base + "_A.txt";
  const bool jacobian = WriteLines(path, A.size(), [&](std::size_t k) {
    return Formatted("% 10d % 10d %17f\n", A[k].row, A[k].column, A[k].value);
  });
  const std::string rows = std::to_string(num_rows_);
  const std::string columns = std::to_string(num_columns_);
  const std::string script =
      "function lsqp = load_trust_region_problem()\nlsqp.num_rows = " + rows +
      ";\nlsqp.num_cols = " + columns + ";\ntmp = load('" + path +
      "', '-ascii');\nlsqp.A = sparse(tmp(:, 1) + 1, tmp(:, 2) + 1, "
      "tmp(:, 3), " +
      rows + ", " + columns + ");\n" + LoadLine("D", base + "_D.txt") +
      LoadLine("b", base + "_b.txt") + LoadLine("x", base + "_x.txt");
  const bool loader = WriteLines(base + ".m", 1, [&](std::size_t) { return script; });
  return loader && jacobian && WriteVector(base + "_D.txt", D) && WriteVector(base + "_b.txt", b) &&
         WriteVector(base + "_x.txt", x);
}

}  // namespace inceres::internal
