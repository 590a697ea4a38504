// Rows of numbers as packs, one per field: in terms of the other vocabulary, for the sets that have
// nothing faster of their own. A more specialised overload wins over these.
#pragma once

namespace gsfw {
namespace GSFW_ISA {

/// The fields of sixteen rows of ``FIELDS`` numbers that follow one another; the rows from
/// ``count`` on are 0 and not read.
template <int FIELDS, typename T>
GSFW_FUNCTION void load_rows(const T* from, int64_t count, Pack<T>* fields) {
  for (int k = 0; k < FIELDS; ++k) fields[k] = load_strided(from + k, FIELDS, count);
}

/// Write the fields of ``count`` rows of ``FIELDS`` numbers that follow one another.
template <int FIELDS, typename T>
GSFW_FUNCTION void store_rows(T* to, int64_t count, const Pack<T>* fields) {
  for (int k = 0; k < FIELDS; ++k) {
    store_strided(to + k, FIELDS, first_lanes<T>(count), fields[k]);
  }
}

/// Lane i of pack k becomes lane k of pack i, for sixteen packs.
template <typename T>
GSFW_FUNCTION void transpose(Pack<T>* packs) {
  T rows[LANES][LANES], columns[LANES][LANES];
  for (int k = 0; k < LANES; ++k) store(rows[k], packs[k]);
  for (int k = 0; k < LANES; ++k) {
    for (int i = 0; i < LANES; ++i) columns[i][k] = rows[k][i];
  }
  for (int i = 0; i < LANES; ++i) packs[i] = load(columns[i]);
}

}  // namespace GSFW_ISA
}  // namespace gsfw
