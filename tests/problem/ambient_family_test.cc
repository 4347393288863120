#include "inceres/problem/ambient_family.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace inceres {
namespace {

constexpr double kUntouched = -77.0;

class Projection : public testing::TestWithParam<int> {
 protected:
  std::vector<double> RandomValues(int count) {
    std::vector<double> values(static_cast<std::size_t>(count));
    for (double& value : values) {
      value = std::uniform_real_distribution<double>(-1.0, 1.0)(random_);
    }
    return values;
  }

  // J_ambient · M into rows of stride tangent_size + 3, checked against a plain triple loop; the
  // padding must stay as it was.
  void ExpectProduct(const TangentMap& map, const std::vector<double>& M, int num_rows) {
    const int stride = map.tangent_size + 3;
    const std::vector<double> J = RandomValues(num_rows * map.ambient_size);
    std::vector<double> result(static_cast<std::size_t>(num_rows * stride), kUntouched);
    ProjectToTangentSpace(map, J.data(), num_rows, result.data(), stride);
    for (int r = 0; r < num_rows; ++r) {
      for (int c = 0; c < stride; ++c) {
        double expected = c < map.tangent_size ? 0.0 : kUntouched;
        for (int k = 0; c < map.tangent_size && k < map.ambient_size; ++k) {
          expected += J[static_cast<std::size_t>(r * map.ambient_size + k)] *
                      M[static_cast<std::size_t>(k * map.tangent_size + c)];
        }
        ASSERT_NEAR(result[static_cast<std::size_t>(r * stride + c)], expected, 1e-14)
            << "row " << r << ", column " << c;
      }
    }
  }

  std::mt19937_64 random_{99};
};

TEST_P(Projection, DenseIsTheProduct) {
  const int tangent_size = GetParam();
  for (const int extra : {0, 1, 4}) {
    TangentMap map{TangentMap::Kind::kDense, tangent_size + extra, tangent_size, nullptr, nullptr};
    const std::vector<double> M = RandomValues(map.ambient_size * tangent_size);
    map.plus_jacobian = M.data();
    for (const int num_rows : {1, 2, 3, 15}) {
      ExpectProduct(map, M, num_rows);
    }
  }
}

TEST_P(Projection, LeadingIdentityColumnsAreCopied) {
  const int dense_columns = GetParam();
  for (const int identity_columns : {1, 2, 3, 6}) {
    TangentMap map{TangentMap::Kind::kDense, identity_columns + dense_columns + 1,
                   identity_columns + dense_columns, nullptr, nullptr};
    map.num_identity_columns = identity_columns;
    std::vector<double> M = RandomValues(map.ambient_size * map.tangent_size);
    for (int r = 0; r < map.ambient_size; ++r) {
      for (int c = 0; c < map.tangent_size; ++c) {
        if (r < identity_columns || c < identity_columns) {
          M[static_cast<std::size_t>(r * map.tangent_size + c)] = r == c ? 1.0 : 0.0;
        }
      }
    }
    map.plus_jacobian = M.data();
    ExpectProduct(map, M, 3);
  }
}

TEST_P(Projection, IdentityIsACopy) {
  const int size = GetParam();
  std::vector<double> M(static_cast<std::size_t>(size * size), 0.0);
  for (int k = 0; k < size; ++k) {
    M[static_cast<std::size_t>(k * size + k)] = 1.0;
  }
  ExpectProduct({TangentMap::Kind::kIdentity, size, size, nullptr, nullptr}, M, 3);
}

TEST_P(Projection, SelectionPicksColumns) {
  const int tangent_size = GetParam();
  const int ambient_size = tangent_size + 2;
  std::vector<double> M(static_cast<std::size_t>(ambient_size * tangent_size), 0.0);
  std::vector<int> selection;
  for (int c = 0; c < tangent_size; ++c) {
    // not ascending: the order of a selection is free
    selection.push_back(c == 0 ? ambient_size - 1 : c);
    M[static_cast<std::size_t>(selection.back() * tangent_size + c)] = 1.0;
  }
  ExpectProduct(
      {TangentMap::Kind::kSelection, ambient_size, tangent_size, M.data(), selection.data()}, M, 4);
}

TEST_P(Projection, ConstantIsNotWritten) {
  const int size = GetParam();
  const std::vector<double> J = RandomValues(2 * size);
  std::vector<double> result(static_cast<std::size_t>(2 * size), kUntouched);
  ProjectToTangentSpace({TangentMap::Kind::kConstant, size, size, nullptr, nullptr}, J.data(), 2,
                        result.data(), size);
  EXPECT_EQ(result, std::vector<double>(static_cast<std::size_t>(2 * size), kUntouched));
}

INSTANTIATE_TEST_SUITE_P(Sizes, Projection, testing::Values(1, 2, 3, 4, 6, 7, 9, 11, 15));

// f = (a² + b, a·b) of a slot (a, unused) and a slot (b): `fault` breaks factor 2 in one of the
// ways a user can.
enum class Fault {
  kNone,
  kReturnsFalse,
  kForgottenResidual,
  kInfiniteResidual,
  kForgottenJacobian,
  kNanJacobian
};

class ToyFamily final : public AmbientFamily<ToyFamily> {
 public:
  ToyFamily(int size, Fault fault)
      : AmbientFamily(2, {{2, 1}, {1, 1}}), size_(size), fault_(fault) {}
  int size() const override { return size_; }
  const char* Name() const override { return "toy"; }

  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    const bool broken = i == 2;
    const double a = parameters[0][0];
    const double b = parameters[1][0];
    residuals[0] = a * a + b;
    if (!(broken && fault_ == Fault::kForgottenResidual)) {
      residuals[1] = broken && fault_ == Fault::kInfiniteResidual
                         ? std::numeric_limits<double>::infinity()
                         : a * b;
    }
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = 2.0 * a;
      jacobians[0][1] = 0.0;
      jacobians[0][2] = broken && fault_ == Fault::kNanJacobian ? std::nan("") : b;
      if (!(broken && fault_ == Fault::kForgottenJacobian)) {
        jacobians[0][3] = 0.0;
      }
    }
    if (jacobians != nullptr && jacobians[1] != nullptr) {
      jacobians[1][0] = 1.0;
      jacobians[1][1] = a;
    }
    return !(broken && fault_ == Fault::kReturnsFalse);
  }

 private:
  int size_;
  Fault fault_;
};

class AmbientFamilyTest : public testing::Test {
 protected:
  static constexpr int kSize = 4;

  EvaluationFailure Evaluate(Fault fault, bool with_jacobians, int begin = 0, int end = kSize) {
    const ToyFamily family(kSize, fault);
    const FactorBatch batch{begin,
                            end,
                            parameters_,
                            with_jacobians ? maps_ : nullptr,
                            residuals_.data(),
                            with_jacobians ? views_ : nullptr};
    return family.Evaluate(batch);
  }

  double a_[2] = {3.0, 5.0};
  double b_ = 7.0;
  const double* parameters_[2 * kSize] = {a_, &b_, a_, &b_, a_, &b_, a_, &b_};
  const int selection_[1] = {0};
  const double M_[2] = {1.0, 0.0};
  TangentMap selected_{TangentMap::Kind::kSelection, 2, 1, M_, selection_};
  TangentMap identity_{TangentMap::Kind::kIdentity, 1, 1, nullptr, nullptr};
  TangentMap constant_{TangentMap::Kind::kConstant, 1, 1, nullptr, nullptr};
  const TangentMap* maps_[2 * kSize] = {&selected_, &identity_, &selected_, &constant_,
                                        &selected_, &identity_, &selected_, &identity_};
  std::vector<double> residuals_ = std::vector<double>(2 * kSize, kUntouched);
  std::vector<double> J_a_ = std::vector<double>(4 * kSize, kUntouched);
  std::vector<double> J_b_ = std::vector<double>(2 * kSize, kUntouched);
  const JacobianView views_[2] = {{J_a_.data(), 4, 2}, {J_b_.data(), 2, 1}};
};

TEST_F(AmbientFamilyTest, WritesResidualsAndProjectedJacobians) {
  ASSERT_FALSE(Evaluate(Fault::kNone, true).failed());
  for (std::size_t i = 0; i < kSize; ++i) {
    EXPECT_EQ(residuals_[2 * i], 16.0);
    EXPECT_EQ(residuals_[2 * i + 1], 21.0);
    EXPECT_EQ(J_a_[4 * i], 6.0);
    EXPECT_EQ(J_a_[4 * i + 1], kUntouched);  // padding
    EXPECT_EQ(J_a_[4 * i + 2], 7.0);
    EXPECT_EQ(J_b_[2 * i], i == 1 ? kUntouched : 1.0);  // factor 1 holds b constant
    EXPECT_EQ(J_b_[2 * i + 1], i == 1 ? kUntouched : 3.0);
  }
}

TEST_F(AmbientFamilyTest, KeepsToItsRange) {
  ASSERT_FALSE(Evaluate(Fault::kNone, true, 1, 3).failed());
  EXPECT_EQ(residuals_[0], kUntouched);
  EXPECT_EQ(residuals_[2], 16.0);
  EXPECT_EQ(residuals_[6], kUntouched);
  EXPECT_EQ(J_a_[0], kUntouched);
  EXPECT_EQ(J_a_[12], kUntouched);
}

TEST_F(AmbientFamilyTest, NamesTheFactorAndTheFault) {
  struct Case {
    Fault fault;
    bool with_jacobians;
    const char* word;
  };
  for (const Case& c :
       {Case{Fault::kReturnsFalse, false, "false"}, Case{Fault::kReturnsFalse, true, "false"},
        Case{Fault::kForgottenResidual, false, "residual"},
        Case{Fault::kForgottenResidual, true, "residual"},
        Case{Fault::kInfiniteResidual, false, "residual"},
        Case{Fault::kForgottenJacobian, true, "Jacobian"},
        Case{Fault::kNanJacobian, true, "Jacobian"}}) {
    const EvaluationFailure failure = Evaluate(c.fault, c.with_jacobians);
    EXPECT_EQ(failure.factor, 2);
    EXPECT_NE(std::string(failure.reason).find(c.word), std::string::npos) << failure.reason;
  }
  EXPECT_FALSE(
      Evaluate(Fault::kNanJacobian, false).failed());  // a cost-only call asks for no Jacobian
}

// f = a x + b y of one row over x (size 2), a constant and y (1): Jacobians that may be written
// straight to their places.
class RowFamily final : public AmbientFamily<RowFamily> {
 public:
  explicit RowFamily(Fault fault) : AmbientFamily(1, {{2, 2}, {1, 1}, {1, 1}}), fault_(fault) {}
  int size() const override { return 5; }
  const char* Name() const override { return "row"; }

  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    const bool broken = i == 2;
    if (!(broken && fault_ == Fault::kForgottenResidual)) {
      residuals[0] = broken && fault_ == Fault::kInfiniteResidual
                         ? HUGE_VAL
                         : i * parameters[0][0] + parameters[2][0];
    }
    if (jacobians != nullptr) {
      EXPECT_EQ(jacobians[1], nullptr);
      jacobians[0][0] = i;
      if (!(broken && fault_ == Fault::kForgottenJacobian)) {
        jacobians[0][1] = 0.5;
      }
      jacobians[2][0] = broken && fault_ == Fault::kNanJacobian ? std::nan("") : -1.0;
    }
    return !(broken && fault_ == Fault::kReturnsFalse) && !(i == 4 && fault_ != Fault::kNone);
  }

 private:
  Fault fault_;
};

class RowFamilyTest : public testing::Test {
 protected:
  // Rows four apart of x and y side by side, or those of each by themselves; the maps of factor 3
  // are other objects or the same.
  EvaluationFailure Evaluate(Fault fault, bool together, bool same_maps) {
    J_.assign(40, kUntouched);
    const JacobianView together_views[3] = {
        {J_.data(), 4, 4}, {J_.data(), 4, 4}, {J_.data() + 2, 4, 4}};
    const JacobianView apart_views[3] = {
        {J_.data(), 4, 4}, {J_.data(), 4, 4}, {J_.data() + 20, 4, 4}};
    const TangentMap maps[2][3] = {{Map(2), constant_, Map(1)}, {Map(2), constant_, Map(1)}};
    std::vector<const TangentMap*> pointers;
    std::vector<const double*> parameters;
    for (int i = 0; i < 5; ++i) {
      for (int s = 0; s < 3; ++s) {
        pointers.push_back(&maps[i == 3 && !same_maps][s]);
        parameters.push_back(values_);
      }
    }
    return RowFamily(fault).Evaluate({1, 5, parameters.data(), pointers.data(), residuals_,
                                      together ? together_views : apart_views});
  }

  static TangentMap Map(int size) {
    return {TangentMap::Kind::kIdentity, size, size, nullptr, nullptr};
  }

  const TangentMap constant_{TangentMap::Kind::kConstant, 1, 0, nullptr, nullptr};
  const double values_[2] = {3.0, 4.0};
  double residuals_[5] = {};
  std::vector<double> J_;
};

TEST_F(RowFamilyTest, WritesRows) {
  for (const bool together : {false, true}) {
    for (const bool same_maps : {false, true}) {
      ASSERT_FALSE(Evaluate(Fault::kNone, together, same_maps).failed());
      for (std::size_t i = 0; i < 5; ++i) {
        const auto value = static_cast<double>(i);
        EXPECT_EQ(residuals_[i], i == 0 ? 0.0 : 3.0 * value + 3.0);
        const std::size_t y = together ? 4 * i + 2 : 20 + 4 * i;
        EXPECT_EQ(J_[4 * i], i == 0 ? kUntouched : value);
        EXPECT_EQ(J_[4 * i + 1], i == 0 ? kUntouched : 0.5);
        EXPECT_EQ(J_[y], i == 0 ? kUntouched : -1.0);
        EXPECT_EQ(J_[y + 1], kUntouched);
      }
    }
  }
}

// Whatever a later factor does.
TEST_F(RowFamilyTest, NamesTheFirstFactorAtFault) {
  struct Case {
    Fault fault;
    const char* word;
  };
  for (const Case& c :
       {Case{Fault::kReturnsFalse, "false"}, Case{Fault::kForgottenResidual, "residual"},
        Case{Fault::kInfiniteResidual, "residual"}, Case{Fault::kForgottenJacobian, "Jacobian"},
        Case{Fault::kNanJacobian, "Jacobian"}}) {
    for (const bool together : {false, true}) {
      for (const bool same_maps : {false, true}) {
        const EvaluationFailure failure = Evaluate(c.fault, together, same_maps);
        EXPECT_EQ(failure.factor, 2);
        EXPECT_NE(std::string(failure.reason).find(c.word), std::string::npos) << failure.reason;
      }
    }
  }
}

// Poses [p, q] and points, more than are taken over at a time; two factors may be at fault.
class PoseFamily final : public AmbientFamily<PoseFamily> {
 public:
  static constexpr int kSize = 21;
  PoseFamily(int bad_pose, int bad_point)
      : AmbientFamily(2, {{7, 6}, {3, 3}}), bad_pose_(bad_pose), bad_point_(bad_point) {}
  int size() const override { return kSize; }
  const char* Name() const override { return "pose"; }
  static double Entry(int i, int k) { return std::sin(100.0 * i + k); }
  bool EvaluateOne(int i, const double* const*, double* residuals, double** jacobians) const {
    residuals[0] = residuals[1] = i;
    for (int k = 0; jacobians[0] != nullptr && k < 14; ++k) {
      jacobians[0][k] = i == bad_pose_ && k == 9 ? std::nan("") : Entry(i, k);
    }
    for (int k = 0; jacobians[1] != nullptr && k < (i == bad_point_ ? 5 : 6); ++k) {
      jacobians[1][k] = Entry(i, 20 + k);
    }
    return true;
  }

 private:
  int bad_pose_;
  int bad_point_;
};

class PoseFamilyTest : public testing::Test {
 protected:
  static constexpr std::size_t kSize = PoseFamily::kSize;

  // Every third pose is held constant, every fourth is as in VINS, the others turn.
  void SetUp() override {
    for (std::size_t k = 0; k < 42; ++k) {
      const bool is_unit = k < 18 || k % 6 < 3;
      turning_M_[k] = is_unit ? (k / 6 == k % 6 ? 1.0 : 0.0) : std::cos(static_cast<double>(k));
    }
    for (std::size_t i = 0; i < kSize; ++i) {
      maps_.push_back(i % 3 == 1 ? &constant_ : i % 4 == 3 ? &copied_ : &turning_);
      maps_.push_back(&point_);
    }
  }

  EvaluationFailure Evaluate(int bad_pose, int bad_point) {
    const JacobianView views[2] = {{J_pose_.data(), 16, 8}, {J_point_.data(), 8, 4}};
    return PoseFamily(bad_pose, bad_point)
        .Evaluate(
            {0, PoseFamily::kSize, parameters_.data(), maps_.data(), residuals_.data(), views});
  }

  std::vector<double> turning_M_ = std::vector<double>(42);
  const int selection_[6] = {0, 1, 2, 3, 4, 5};
  TangentMap turning_{TangentMap::Kind::kDense, 7, 6, turning_M_.data(), nullptr, 3};
  TangentMap copied_{TangentMap::Kind::kSelection, 7, 6, nullptr, selection_, 6};
  TangentMap constant_{TangentMap::Kind::kConstant, 7, 6, nullptr, nullptr};
  TangentMap point_{TangentMap::Kind::kIdentity, 3, 3, nullptr, nullptr};
  std::vector<const TangentMap*> maps_;
  std::vector<const double*> parameters_ = std::vector<const double*>(2 * kSize);
  std::vector<double> residuals_ = std::vector<double>(2 * kSize);
  std::vector<double> J_pose_ = std::vector<double>(16 * kSize, kUntouched);
  std::vector<double> J_point_ = std::vector<double>(8 * kSize, kUntouched);
};

// To the bit what each would be by itself.
TEST_F(PoseFamilyTest, TakesGroupsAsOneByOne) {
  ASSERT_FALSE(Evaluate(-1, -1).failed());
  for (std::size_t i = 0; i < kSize; ++i) {
    double J[14];
    for (int k = 0; k < 14; ++k) {
      J[k] = PoseFamily::Entry(static_cast<int>(i), k);
    }
    std::vector<double> expected(16, kUntouched);
    ProjectToTangentSpace(*maps_[2 * i], J, 2, expected.data(), 8);
    EXPECT_EQ(std::vector<double>(&J_pose_[16 * i], &J_pose_[16 * i] + 16), expected) << i;
    for (std::size_t k = 0; k < 6; ++k) {
      EXPECT_EQ(J_point_[8 * i + k / 3 * 4 + k % 3],
                PoseFamily::Entry(static_cast<int>(i), 20 + static_cast<int>(k)));
    }
  }
}

TEST_F(PoseFamilyTest, NamesTheFirstFactorAtFaultWhicheverItsSlot) {
  for (const auto& [bad_pose, bad_point] :
       {std::pair{11, 9}, std::pair{9, 11}, std::pair{14, -1}, std::pair{-1, 20}}) {
    const EvaluationFailure failure = Evaluate(bad_pose, bad_point);
    const bool of_pose = bad_pose >= 0 && (bad_point < 0 || bad_pose < bad_point);
    EXPECT_EQ(failure.factor, of_pose ? bad_pose : bad_point);
    EXPECT_EQ(failure.slot, of_pose ? 0 : 1);
    EXPECT_EQ(failure.entry, of_pose ? 9 : 5);
  }
}

// Entries whose sum proves nothing are looked at one by one.
TEST(AmbientFamily, TakesLargeEntriesForWhatTheyAre) {
  class LargeFamily final : public AmbientFamily<LargeFamily> {
   public:
    LargeFamily() : AmbientFamily(2, {{3, 3}}) {}
    int size() const override { return 2; }
    const char* Name() const override { return "large"; }
    bool EvaluateOne(int, const double* const*, double* residuals, double** jacobians) const {
      residuals[0] = residuals[1] = 1e301;
      std::fill_n(jacobians[0], 6, -1e301);
      return true;
    }
  };
  const double x[3] = {};
  const double* parameters[2] = {x, x};
  const TangentMap identity{TangentMap::Kind::kIdentity, 3, 3, nullptr, nullptr};
  const TangentMap* maps[2] = {&identity, &identity};
  std::vector<double> residuals(4);
  std::vector<double> J(12);
  const JacobianView view = {J.data(), 6, 3};
  ASSERT_FALSE(LargeFamily().Evaluate({0, 2, parameters, maps, residuals.data(), &view}).failed());
  EXPECT_EQ(J, std::vector<double>(12, -1e301));
}

// More slots and larger Jacobians than the scratch on the stack holds.
class WideFamily final : public AmbientFamily<WideFamily> {
 public:
  WideFamily() : AmbientFamily(3, std::vector<Slot>(40, Slot{11, 11})) {}
  int size() const override { return 1; }
  const char* Name() const override { return "wide"; }
  bool EvaluateOne(int, const double* const*, double* residuals, double** jacobians) const {
    for (int r = 0; r < 3; ++r) {
      residuals[r] = r;
    }
    for (int s = 0; jacobians != nullptr && s < num_slots(); ++s) {
      for (int k = 0; k < 33; ++k) {
        jacobians[s][k] = 100.0 * s + k;
      }
    }
    return true;
  }
};

TEST(AmbientFamily, ServesWideFactors) {
  const WideFamily family;
  const std::vector<double> x(11, 0.0);
  const std::vector<const double*> parameters(40, x.data());
  const TangentMap identity{TangentMap::Kind::kIdentity, 11, 11, nullptr, nullptr};
  const std::vector<const TangentMap*> maps(40, &identity);
  std::vector<std::vector<double>> J(40, std::vector<double>(33));
  std::vector<JacobianView> views;
  for (std::vector<double>& block : J) {
    views.push_back({block.data(), 33, 11});
  }
  double residuals[3];
  ASSERT_FALSE(
      family.Evaluate({0, 1, parameters.data(), maps.data(), residuals, views.data()}).failed());
  for (std::size_t s = 0; s < J.size(); ++s) {
    for (std::size_t k = 0; k < 33; ++k) {
      ASSERT_EQ(J[s][k], 100.0 * static_cast<double>(s) + static_cast<double>(k));
    }
  }
}

// Many slots, of which each factor writes zeros to all but a few.
class SparseFamily final : public AmbientFamily<SparseFamily> {
 public:
  enum class Wrong { kNothing, kNan, kForgotten };

  explicit SparseFamily(Wrong wrong = Wrong::kNothing) : AmbientFamily(2, Slots()), wrong_(wrong) {}
  int size() const override { return 3; }
  const char* Name() const override { return "sparse"; }
  bool EvaluateOne(int i, const double* const*, double* residuals, double** jacobians) const {
    residuals[0] = residuals[1] = i;
    for (int s = 0; s < num_slots(); ++s) {
      for (int k = 0; jacobians[s] != nullptr && k < 2 * slot(s).ambient_size; ++k) {
        jacobians[s][k] = IsZero(i, s) ? -0.0 : 100.0 * i + s + 0.01 * k;
      }
      if (i == 2 && s == kZeroSlot && wrong_ != Wrong::kNothing) {
        jacobians[s][0] = wrong_ == Wrong::kNan ? std::nan("") : kUnwritten;
      }
    }
    return true;
  }

  static constexpr int kZeroSlot = 20;  // of all factors
  static bool IsZero(int i, int s) { return s == kZeroSlot || (s != 0 && s % 7 != i); }

 private:
  // 1, 2, 3, 4, 1, …
  static std::vector<Slot> Slots() {
    std::vector<Slot> slots;
    for (int s = 0; s < 40; ++s) {
      slots.push_back({1 + s % 4, 1 + s % 4});
    }
    return slots;
  }
  Wrong wrong_;
};

class SparseFamilyTest : public testing::Test {
 protected:
  static constexpr int kConstant = 14;  // a slot that factor 0 would write to

  EvaluationFailure Evaluate(const SparseFamily& family) {
    const auto num_slots = static_cast<std::size_t>(family.num_slots());
    const std::vector<double> x(4, 0.0);
    const std::vector<const double*> parameters(3 * num_slots, x.data());
    std::vector<TangentMap> maps;
    for (int s = 0; s < family.num_slots(); ++s) {
      const int size = family.slot(s).ambient_size;
      maps.push_back({s == kConstant ? TangentMap::Kind::kConstant : TangentMap::Kind::kIdentity,
                      size, size, nullptr, nullptr});
      J_.emplace_back(static_cast<std::size_t>(3 * 2 * size), kUntouched);
      views_.push_back({J_.back().data(), 2 * size, size});
    }
    std::vector<const TangentMap*> pointers;
    for (std::size_t k = 0; k < 3 * num_slots; ++k) {
      pointers.push_back(&maps[k % num_slots]);
    }
    zero_blocks_ = std::make_unique<bool[]>(3 * num_slots);
    FactorBatch batch{1, 3, parameters.data(), pointers.data(), residuals_, views_.data()};
    batch.zero_blocks = zero_blocks_.get();
    EvaluationFailure failure = family.Evaluate(batch);
    batch.begin = 0;
    batch.end = 1;
    return failure.failed() ? failure : family.Evaluate(batch);
  }

  std::vector<std::vector<double>> J_;
  std::vector<JacobianView> views_;
  double residuals_[6] = {};
  std::unique_ptr<bool[]> zero_blocks_;
};

TEST_F(SparseFamilyTest, SaysWhichBlocksAreZeroAndWritesTheOthers) {
  const SparseFamily family;
  ASSERT_FALSE(Evaluate(family).failed());
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(residuals_[2 * i + 1], i);
    for (int s = 0; s < family.num_slots(); ++s) {
      const bool is_zero = SparseFamily::IsZero(i, s);
      const int size = 2 * family.slot(s).ambient_size;
      EXPECT_EQ(zero_blocks_[i * family.num_slots() + s], is_zero && s != kConstant)
          << i << ", " << s;
      for (int k = 0; k < size; ++k) {
        EXPECT_EQ(J_[static_cast<std::size_t>(s)][static_cast<std::size_t>(i * size + k)],
                  is_zero || s == kConstant ? kUntouched : 100.0 * i + s + 0.01 * k)
            << i << ", " << s << ", " << k;
      }
    }
  }
}

TEST_F(SparseFamilyTest, NamesTheFault) {
  for (const SparseFamily::Wrong wrong :
       {SparseFamily::Wrong::kNan, SparseFamily::Wrong::kForgotten}) {
    const EvaluationFailure failure = Evaluate(SparseFamily(wrong));
    EXPECT_EQ(failure.factor, 2);
    EXPECT_EQ(failure.slot, SparseFamily::kZeroSlot);
    EXPECT_EQ(failure.entry, 0);
  }
}

}  // namespace
}  // namespace inceres
