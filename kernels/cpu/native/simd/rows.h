// Rows of numbers as packs, one per field, and sets of bits: in terms of the other vocabulary, for the sets that have
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

/// ``PART_LANES`` numbers from memory.
template <typename T>
GSFW_FUNCTION Part<T> load_part(const T* from) {
  return load(from);
}

/// Bits ``first`` to ``end`` - 1 of each lane, both of which are whole numbers from 0 to 16.
template <typename T>
GSFW_FUNCTION void bit_ranges(const Pack<T>& first, const Pack<T>& end, uint16_t* to) {
  T low[LANES], high[LANES];
  store(low, first);
  store(high, end);
  for (int i = 0; i < LANES; ++i) to[i] = uint16_t((1u << int(high[i])) - (1u << int(low[i])));
}

/// Write those of sixteen numbers that are not 0, one after the other, and what ``labels`` has in
/// their places plus ``base``. Returns how many, and may write sixteen of both.
template <typename Label>
GSFW_FUNCTION int keep_nonzero(const uint16_t* numbers, const Label* labels, Label base,
                               uint16_t* to, Label* to_labels) {
  int count = 0;
  for (int i = 0; i < LANES; ++i) {
    to[count] = numbers[i];
    to_labels[count] = labels[i] + base;
    count += numbers[i] != 0;
  }
  return count;
}

}  // namespace GSFW_ISA
}  // namespace gsfw
