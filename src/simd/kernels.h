#pragma once

#include <cstddef>
#include <cstdint>

namespace inceres::internal {

/// What kernels read is padded to a multiple of four doubles: a row of Y, a variable in a tangent
/// vector, and a row of a Jacobian, unless it is kept without (SlotJacobians). The padding is zero.
/// Offsets of blocks are counted in such quads, so 32 bits reach 64 GiB.
constexpr int kQuad = 4;
static constexpr int PadToQuad(int size) {
  return (size + kQuad - 1) / kQuad * kQuad;
}

/// Whether blocks of Y with rows of so many entries may be kept with their last column apart, as
/// one quad behind the rows: three rows of 9, the camera of a BAL problem, then take 7 quads
/// instead of 9. Of residuals or landmarks of size 4 at most.
static constexpr bool MayHaveTail(int size) {
  return size == 5 || size == 9 || size == 13;
}
/// Quads of such a block.
static constexpr int QuadsWithTail(int depth, int size) {
  return depth * (size / kQuad) + 1;
}

/// Where the two factors of a product start, each from its base pointer: blocks in quads, a vector
/// in doubles. A symmetric product of blocks has one factor, `a`, and does not read `b`: so what
/// sums AᵀA over some terms and then Aᵀv has one list of them, with the places of v.
struct ProductTerm {
  std::int32_t a;
  std::int32_t b;
};

/// C += sign Σ_p B_pᵀ A_p, the one product behind both H_ij = Σ J_iᵀ J_j and S_ij = C_ij − Σ_l Y_il
/// Y_jlᵀ. A_p is depth × a_size and B_p depth × b_size, row-major, rows padded to quads, or both
/// with their last column apart (`tail`: then a_size equals b_size, and depth is 4 at most), or
/// a_stride and b_stride apart, if these are not 0. C is b_size × a_size with rows padded to quads;
/// what is added to its padding does not count.
///
/// `symmetric`: every B_p is its A_p, whatever the terms say, so that C is symmetric. Then only its
/// entries up to the diagonal count: those above it may have been added to or not.
struct BlockProducts {
  const double* a = nullptr;
  const double* b = nullptr;
  const ProductTerm* terms = nullptr;
  int count = 0;
  int depth = 0;  // residual size for H, landmark size for S
  int a_size = 0;
  int b_size = 0;
  bool tail = false;
  bool symmetric = false;
  int a_stride = 0;  // from row to row, if they are not padded to quads
  int b_stride = 0;
  // all operands are in the processor's own caches: nothing is fetched ahead
  bool is_near = false;
};

/// Whether operands in so many doubles count as near: no more than the second-level cache holds.
static constexpr bool AreNear(std::int64_t size) {
  return size <= std::int64_t{1} << 15;  // 256 KiB
}

/// y += sign Σ_p A_pᵀ v_p: gradients (A = J, v = f) and the right hand side b (A = Yᵀ, v = z). y
/// has PadToQuad(a_size) entries. Where the last column of A is apart (`tail`), v_p is a quad, zero
/// beyond depth.
struct VectorProducts {
  const double* a = nullptr;
  const double* v = nullptr;
  const ProductTerm* terms = nullptr;
  int count = 0;
  int depth = 0;
  int a_size = 0;
  bool tail = false;
  int a_stride = 0;  // as of BlockProducts
};

/// The Jacobians of one slot over a family: block i starts at data + i · factor_stride, which is a
/// multiple of 4, its rows row_stride apart. Rows are padded to quads, or, where J is kept by
/// factor (linearize/linearization.h), they are not: row_stride is `columns` then, and kernels may
/// read up to three entries beyond a block, of which they use none.
struct SlotJacobians {
  double* data = nullptr;
  std::ptrdiff_t factor_stride = 0;
  int row_stride = 0;
  int columns = 0;  // the slot's tangent size
  // Where J is kept in single precision, with the same strides; `data` is null then, but for those
  // who linearize. Kernels for landmarks, and products of rows, read these, too.
  float* single = nullptr;

  /// Of BlockProducts and VectorProducts: 0 where rows are padded, or need not be.
  int UnpaddedStride() const { return row_stride % kQuad != 0 ? row_stride : 0; }
};

/// The factors of one landmark within one family, seen from its elimination.
struct LandmarkFactors {
  const std::int32_t* factors = nullptr;
  int count = 0;
  int residual_size = 0;
  int landmark_slot = 0;
  int num_slots = 0;
  const SlotJacobians* jacobians = nullptr;  // per slot
  const double* residuals = nullptr;         // residual_size per factor; null: they do not count
  /// Per factor and slot: 2 · (quad offset of the Y block) + 1 if the block was begun by an earlier
  /// factor; -1: no frame here.
  const std::int32_t* y_targets = nullptr;
  const std::int32_t* tangent_offsets =
      nullptr;            // as those of FactorRows; multiply_coupling and add_coupling read them
  bool y_tail = false;    // all blocks of Y have their last column apart
  std::int32_t list = 0;  // of LandmarkIncidences; no kernel reads it
};

/// Landmarks with all of their factors and with U_inv of each, as that of `eliminate`.
struct CoupledLandmarks {
  const int* factors_begin = nullptr;  // per landmark, and one more: its entries of `factors`
  const LandmarkFactors* factors = nullptr;
  const char* sizes = nullptr;
  const double* U_inv = nullptr;
  std::ptrdiff_t U_inv_stride = 0;  // from landmark to landmark
};

/// The factors [begin, end) of a family for products with J.
struct FactorRows {
  int begin = 0;
  int end = 0;
  int residual_size = 0;
  int num_slots = 0;
  const SlotJacobians* jacobians = nullptr;
  const double* residuals = nullptr;
  // per factor and slot: quad offset into the padded tangent vector, or -1
  const std::int32_t* tangent_offsets = nullptr;
};

/// What a pass over J yields for a tangent vector v.
struct RowProducts {
  double model_decrease = 0.0;  // −(Jv)ᵀ(f + Jv/2)
  double squared_norm = 0.0;    // ‖Jv‖²
};

/// One landmark's share of the frame step: y −= Y_qᵀ δ_f over its incidences.
struct Incidence {
  std::int32_t y;      // quad offset of Y_q (landmark_size rows)
  std::int32_t frame;  // quad offset of the frame in the padded tangent vector
  std::int32_t quads;  // quads of one row of Y_q
};

/// One block row's share A of a symmetric product Σ A_rᵀ A_c: depth × size, row-major, rows padded
/// to quads.
struct BlockRow {
  const double* A;
  std::int32_t frame;  // quad offset of the row in the padded tangent vector
  std::int32_t quads;  // of one row of A
  std::int32_t size;
  const double* out = nullptr;  // what A replaces, of its shape
};

/// What a landmark (A = Y, depth its size) or a factor (A = J, depth its residual's) adds to a
/// symmetric block matrix and to vectors. Rows by ascending block row. If it replaces what was
/// added before, that goes out in the same pass.
struct Contribution {
  const BlockRow* rows = nullptr;
  int count = 0;
  int depth = 0;
  bool replaces = false;  // every row has an `out`
};

/// What an entry of a Jacobian holds that nobody has written yet; a sum of magnitudes below a
/// hundredth of it proves that none of them is such an entry, infinite or NaN.
constexpr double kUnwrittenEntry = 1e302;

/// Copies the first columns of `count` Jacobians J of a user's, one after the other, to blocks
/// factor_stride apart with rows row_stride apart. If the sum of the magnitudes of J does not prove
/// its entries ordinary, nothing is written and the result is false.
using ColumnTake = bool (*)(int count, const double* J, int rows, double* out,
                            std::ptrdiff_t factor_stride, int row_stride);

/// What a loss makes of the Jacobians of a factor with the residual f: scale (I − a f fᵀ) J.
struct FactorScale {
  double scale;
  double a;
};

/// What a contribution of a factor goes into: C by `blocks`, as add_outer; y and the squares of the
/// columns, with their peaks, as add_transposed and add_squares.
struct ContributionSums {
  const std::int32_t* blocks = nullptr;
  double* C = nullptr;
  const double* v = nullptr;
  const double* v_out = nullptr;
  double* y = nullptr;
  double* y_peak = nullptr;
  double* squares = nullptr;
  double* squares_peak = nullptr;
};

/// Where terms of a kind lie: A_p at a + 4 term.a, B_p at b + 4 term.b, v_p at v + term.v.
struct SmallSource {
  const double* a = nullptr;
  const double* b = nullptr;
  const double* v = nullptr;
};

/// One product B_pᵀA_p, and A_pᵀv_p with it. Terms of a segment are summed by themselves, and then
/// added.
struct SmallTerm {
  std::int32_t a;
  std::int32_t b;
  std::int32_t v;
  std::int16_t source;
  bool ends_segment;
};

/// C = Σ_p B_pᵀA_p over the terms of a block, and of one on the diagonal y = Σ_p A_pᵀv_p, with A_p
/// and B_p of `depth` rows, 3 or 6, and 3 columns, padded to quads.
struct SmallBlock {
  std::int64_t C = 0;  ///< where it begins
  std::int32_t first_term = 0;
  std::int32_t num_terms = 0;  ///< 0: it is not one of these
  std::int32_t y = -1;         ///< where its three entries begin; -1: it is not on the diagonal
};
struct SmallProducts {
  const SmallSource* sources = nullptr;
  const SmallTerm* terms = nullptr;
  int depth = 0;
};

/// A block row of an envelope factor. Offsets of block columns are given beside it.
struct EnvelopeRow {
  double* values = nullptr;          ///< from scalar column `start`, a whole quad, on
  double* inverse_pivots = nullptr;  ///< of its block on the diagonal
  int first_column = 0;              ///< block
  bool held = false;                 ///< a row of the identity
  int start = 0;
  int stride = 0;  ///< between scalar rows: whole quads
};

/// Largest block of a path of tiles.
constexpr int kMostTileScalars = 8;

/// The instruction-set-dependent inner loops. One table an instruction set; all give equal results
/// up to rounding, and each gives the same bits whenever it is called with the same operands.
struct Kernels {
  const char* name;
  int width;  // doubles that an instruction takes

  /// For the sizes; null if there is none of them.
  ColumnTake (*find_take)(int rows, int ambient_size, int columns);
  /// The same of Jacobians with 7 columns, of a position and a quaternion: J_n M_n, of whose M_n (7
  /// × 6) the first three rows and columns are those of the identity. Sums run over the rows of M
  /// upward, each term rounded, as in a plain loop.
  bool (*take_poses)(const double* const* M, int count, const double* J, int rows, double* out,
                     std::ptrdiff_t factor_stride, int row_stride);
  /// The same with 4 columns, of a quaternion: M_n is 4 × 3.
  bool (*take_quaternions)(const double* const* M, int count, const double* J, int rows,
                           double* out, std::ptrdiff_t factor_stride, int row_stride);
  /// Whether the sum of the magnitudes of the values proves that none of them is kUnwrittenEntry,
  /// infinite or NaN.
  bool (*are_ordinary)(const double* values, int count);
  /// The first entry from `begin` on that is not zero, or count.
  int (*find_nonzero)(const double* values, int begin, int count);
  /// Fills them with kUnwrittenEntry.
  void (*mark_unwritten)(double* values, int count);
  /// J_s := scale (I − a f fᵀ) J_s of `count` factors from `first` on, padding included, for the
  /// slots with a tangent offset. Offsets, f and scales begin with those of the first factor.
  void (*correct_factors)(const SlotJacobians* jacobians, int num_slots, int first, int count,
                          const std::int32_t* tangent_offsets, const double* f, int residual_size,
                          const FactorScale* scales);

  void (*accumulate_products)(const BlockProducts& products, double sign, double* C);
  void (*accumulate_vectors)(const VectorProducts& products, double sign, double* y);

  /// P += Σ J_lᵀJ_l (rows four apart), eta += −Σ J_lᵀf, for a landmark of tangent size 1 to 4.
  void (*landmark_gram)(int landmark_size, const LandmarkFactors& factors, double* P, double* eta);
  /// Y_q = Σ J_fᵀ (J_l U_invᵀ): U_inv = L⁻¹ with L Lᵀ = P + Λ, lower triangular, rows four apart.
  void (*eliminate)(int landmark_size, const LandmarkFactors& factors, const double* U_inv,
                    double* Y);
  /// y −= Σ_q Y_qᵀ δ_f(q).
  void (*back_substitute)(int landmark_size, const Incidence* incidences, int count,
                          const double* Y, const double* delta, double* y);
  /// y −= Σ J_fᵀ (J_f v − J_l u) over the factors of the landmarks [begin, end), u = P̃⁻¹ Wᵀ v with
  /// P̃⁻¹ = U_invᵀ U_inv, W = Σ J_fᵀ J_l over the frames f; v and y padded. `products` has room for
  /// the rows of any landmark's factors. Each landmark's Jacobians are read twice, one reading
  /// after the other.
  void (*subtract_reduced)(const CoupledLandmarks& landmarks, int begin, int end, const double* v,
                           double* products, double* y);
  /// y −= Σ Jᵀ (J v) over the listed factors; both padded.
  void (*subtract_normal)(const FactorRows& rows, const std::int32_t* factors, int count,
                          const double* v, double* y);
  /// w += Wᵀ δ = Σ J_lᵀ Σ_f J_f δ_f: what back_substitute needs where Y is not kept. w has four
  /// entries.
  void (*multiply_coupling)(const LandmarkFactors& factors, const double* delta, double* w);
  /// y_f += Σ J_fᵀ (J_l u − p) over the frames f, padded; p has a number for each row of the
  /// factors, one after the other. Null: zeros, which makes it the transpose of multiply_coupling.
  /// u has four entries, zero beyond the landmark's size.
  void (*add_coupling)(const LandmarkFactors& factors, const double* u, const double* p, double* y);
  /// y_f(q) −= Y_q v for every incidence: what a change v of the landmark's z does to b.
  void (*subtract_incidences)(int landmark_size, const Incidence* incidences, int count,
                              const double* Y, const double* v, double* y);

  /// C_rc += sign A_rᵀ A_c for every pair c ≤ r. blocks: the quad offset of C_rc from `C`, row by
  /// row; negative: left out.
  void (*add_outer)(const Contribution& contribution, double sign, const std::int32_t* blocks,
                    double* C);
  /// y_r += sign A_rᵀ v and peak_r = max(peak_r, |y_r|). v_out: what v replaces, if A does.
  void (*add_transposed)(const Contribution& contribution, const double* v, const double* v_out,
                         double sign, double* y, double* peak);
  /// y_r += sign diag(A_rᵀ A_r) and peak_r = max(peak_r, |y_r|).
  void (*add_squares)(const Contribution& contribution, double sign, double* y, double* peak);

  RowProducts (*row_products)(const FactorRows& rows, const double* v);

  /// out_i = J_i v for the listed factors; result i at out + i · residual_size. `begin`, `end` and
  /// `residuals` are not read.
  void (*multiply_rows)(const FactorRows& rows, const std::int32_t* factors, int count,
                        const double* v, double* out);
  /// The two products of a trial step v in one pass over the listed factors: out_i = J_i v, and y
  /// −= Σ J_iᵀ(p_i − q_i) with q = rows.residuals and p the same after the step. Returns −Σ
  /// out_iᵀ(q_i + out_i/2). `begin` and `end` are not read.
  double (*try_rows)(const FactorRows& rows, const std::int32_t* factors, int count,
                     const double* v, const double* p, double* out, double* y);
  /// y −= Σ J_iᵀ r_i over the listed factors, y laid out as v; r_i at r + i · residual_size.
  void (*subtract_transposed)(const FactorRows& rows, const std::int32_t* factors, int count,
                              const double* r, double* y);

  /// C −= A Bᵀ on column-major storage: C is rows × cols, A rows × depth, B cols × depth. The work
  /// of a dense Cholesky.
  void (*subtract_outer)(int rows, int cols, int depth, const double* A, int lda, const double* B,
                         int ldb, double* C, int ldc);
  /// X := X L⁻ᵀ for the lower triangular size × size L, X rows × size; column-major.
  void (*solve_lower_transposed)(int rows, int size, const double* L, int ldl, double* X, int ldx);

  /// C −= A Bᵀ on row-major storage, as dot products along the rows: C is rows × cols, A rows ×
  /// depth, B cols × depth. The work of a Cholesky factorization row by row.
  void (*subtract_row_dots)(int rows, int cols, int depth, const double* A, int lda,
                            const double* B, int ldb, double* C, int ldc);

  /// The first `columns` columns of J (rows row_stride apart), each contiguous and `stride` after
  /// the one before.
  void (*rows_to_columns)(int rows, int columns, const double* J, int row_stride, double* out,
                          int stride);
  /// row_products where [J f] is columns, each `stride` after the one before; rows is a multiple of
  /// 4 and there are columns. Decreases are summed row by row, so that what overflows is an
  /// infinite decrease and not none.
  RowProducts (*column_products)(int rows, int columns, const double* J_f, int stride,
                                 const double* v);

  // Small blocks, such as those of poses, where what is around a product would take longer than the
  // product. Each gives the bits of those above that it stands for.

  /// subtract_outer of B = A's first `cols` rows, on and below the diagonal of C; entries
  /// above it may be anything afterwards.
  void (*subtract_lower_outer)(int rows, int cols, int depth, const double* A, int lda, double* C,
                               int ldc);
  /// Zeros, of whole quads.
  void (*set_zero)(std::int64_t count, double* A);
  /// C += A, both column-major: nothing between the columns is written.
  void (*add_columns)(int rows, int cols, const double* A, int lda, double* C, int ldc);
  /// What a factor adds: add_outer and add_squares with the sign, add_transposed with the other
  /// one. In one pass where all blocks are those of poses, 3 × 3 or 6 × 6.
  void (*add_contribution)(const Contribution& contribution, double sign,
                           const ContributionSums& sums);
  /// Blocks one after the other, C without padding, written and not added to: what
  /// accumulate_products and accumulate_vectors would make of zeros; and the diagonal of C, where y
  /// goes.
  void (*sum_products_of_three)(const SmallProducts& products, const SmallBlock* blocks, int count,
                                double* C, double* y, double* diagonal);

  /// L Lᵀ of a path of blocks of `size` ≤ kMostTileScalars, each coupled to the next one and, once
  /// those before it are eliminated, to one more, the anchor. A tile has the columns of a block: a
  /// section of padded `size` rows for the block itself, one for the anchor, one for the next
  /// block; they follow each other. Behind the last there is one more, of what comes after the
  /// path: its own section and the anchor's lose what the path contributes there; and so does the
  /// anchor's own block, one section a column, unless it is null. In L's own blocks the diagonal
  /// has reciprocals, and above it is anything. The scalar that is not positive and finite; -1:
  /// none.
  int (*eliminate_path)(int size, int count, double* tiles, double* anchor_square);
  /// y := L⁻¹ y of a path, one section a block; the section behind them, and the anchor's, lose
  /// what it contributes to them. Padding is zero.
  void (*solve_path_forward)(int size, int count, const double* tiles, double* y, double* anchor);
  /// y := L⁻ᵀ y, where the section behind the path and the anchor's have their solution already.
  void (*solve_path_backward)(int size, int count, const double* tiles, const double* anchor,
                              double* y);

  /// Blocks [first, end) of row i of an envelope factor, all of them and the row of `size`, 3, 6 or
  /// 9: L_ij = (A_ij − Σ L_ik L_jkᵀ) L_jj⁻ᵀ; and where end = i the block on the diagonal, A_ii − Σ
  /// L_ik L_ikᵀ. Those before `first` are solved.
  void (*solve_envelope_run)(int size, const EnvelopeRow* rows, const int* offsets, int i,
                             int first, int end);
};

enum class InstructionSet { kGeneric, kAvx2, kAvx512, kNeon };

/// The table of an instruction set, or null where the build or the processor has none.
const Kernels* KernelsFor(InstructionSet set);

/// The best table for this processor.
const Kernels& BestKernels();

}  // namespace inceres::internal
