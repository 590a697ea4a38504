// Products of small matrices, whose operands lie in the first- and second-level caches.
//
// C [rows, columns] = A [rows, depth] B [depth, columns], columns a multiple of 16. A block of C is
// held in registers while the depth is run through; entries of A are broadcast, so that A may be
// transposed for nothing.
#pragma once

#include "simd/simd.h"

namespace gsfw {
namespace GSFW_ISA {

/// Rows and packs of a block of C: as many as there are registers for.
#if defined(GSFW_SIMD_avx512)
constexpr int BLOCK_ROWS = 4, BLOCK_PACKS = 4;
#else
constexpr int BLOCK_ROWS = 2, BLOCK_PACKS = 2;
#endif

/// Entry (row, k) of A is ``data[row * row_stride + k * depth_stride]``.
template <typename T>
struct LeftMatrix {
  const T* data;
  int64_t row_stride, depth_stride;
};

/// Row r of the matrix begins at ``data + r * stride``.
template <typename T>
struct PackedMatrix {
  T* data;
  int64_t stride;
};

/// Begin C at zero, at a bias per column, or at what it holds.
enum class Start { zero, bias, kept };

/// One block of C from its depth products.
template <int ROWS, int PACKS, Start START, bool RELU, typename T>
GSFW_FUNCTION void multiply_block(int64_t depth, const LeftMatrix<T>& a, PackedMatrix<const T> b,
                                  const T* bias, PackedMatrix<T> c) {
  Pack<T> sums[ROWS][PACKS];
#pragma GCC unroll 4
  for (int r = 0; r < ROWS; ++r) {
#pragma GCC unroll 4
    for (int p = 0; p < PACKS; ++p) {
      if (START == Start::zero) sums[r][p] = Pack<T>(0.0);
      if (START == Start::bias) sums[r][p] = load(bias + p * LANES);
      if (START == Start::kept) sums[r][p] = load(c.data + r * c.stride + p * LANES);
    }
  }
  for (int64_t k = 0; k < depth; ++k) {
    Pack<T> column[PACKS];
#pragma GCC unroll 4
    for (int p = 0; p < PACKS; ++p) column[p] = load(b.data + k * b.stride + p * LANES);
#pragma GCC unroll 4
    for (int r = 0; r < ROWS; ++r) {
      const Pack<T> entry(a.data[r * a.row_stride + k * a.depth_stride]);
#pragma GCC unroll 4
      for (int p = 0; p < PACKS; ++p) sums[r][p] = fma(entry, column[p], sums[r][p]);
    }
  }
#pragma GCC unroll 4
  for (int r = 0; r < ROWS; ++r) {
#pragma GCC unroll 4
    for (int p = 0; p < PACKS; ++p) {
      // The sum is the second operand: NaN stays NaN.
      const Pack<T> value = RELU ? maximum(Pack<T>(0.0), sums[r][p]) : sums[r][p];
      store(c.data + r * c.stride + p * LANES, value);
    }
  }
}

/// All rows of one panel of columns.
template <int PACKS, Start START, bool RELU, typename T>
GSFW_FUNCTION void multiply_panel(int64_t rows, int64_t depth, LeftMatrix<T> a,
                                  PackedMatrix<const T> b, const T* bias, PackedMatrix<T> c) {
  int64_t row = 0;
  for (; row + BLOCK_ROWS <= rows; row += BLOCK_ROWS) {
    multiply_block<BLOCK_ROWS, PACKS, START, RELU>(depth, a, b, bias, c);
    a.data += BLOCK_ROWS * a.row_stride;
    c.data += BLOCK_ROWS * c.stride;
  }
  for (; row < rows; ++row) {
    multiply_block<1, PACKS, START, RELU>(depth, a, b, bias, c);
    a.data += a.row_stride;
    c.data += c.stride;
  }
}

/// C = A B, from START, with negative entries set to 0 if RELU.
template <Start START, bool RELU, typename T>
void multiply(int64_t rows, int64_t columns, int64_t depth, LeftMatrix<T> a,
              PackedMatrix<const T> b, const T* bias, PackedMatrix<T> c) {
  int64_t column = 0;
  for (; column + BLOCK_PACKS * LANES <= columns; column += BLOCK_PACKS * LANES) {
    multiply_panel<BLOCK_PACKS, START, RELU>(rows, depth, a, {b.data + column, b.stride},
                                             START == Start::bias ? bias + column : nullptr,
                                             {c.data + column, c.stride});
  }
  for (; column < columns; column += LANES) {
    multiply_panel<1, START, RELU>(rows, depth, a, {b.data + column, b.stride},
                                   START == Start::bias ? bias + column : nullptr,
                                   {c.data + column, c.stride});
  }
}

}  // namespace GSFW_ISA
}  // namespace gsfw
