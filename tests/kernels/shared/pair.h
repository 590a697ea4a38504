// The smallest pack there can be: two doubles, and a mask that no condition accepts.
#pragma once

#include "number.h"

namespace gsfw {
namespace GSFW_ISA {

struct PairMask {
  bool first, second;
};

struct Pair {
  double first, second;
  Pair() = default;
  GSFW_FUNCTION Pair(double both) : first(both), second(both) {}
  GSFW_FUNCTION Pair(double one, double two) : first(one), second(two) {}
};

#define PAIR_OPERATOR(result, op)                                  \
  GSFW_FUNCTION result operator op(const Pair& a, const Pair& b) { \
    return {a.first op b.first, a.second op b.second};             \
  }
PAIR_OPERATOR(Pair, +)
PAIR_OPERATOR(Pair, -)
PAIR_OPERATOR(Pair, *)
PAIR_OPERATOR(Pair, /)
PAIR_OPERATOR(PairMask, <)
PAIR_OPERATOR(PairMask, <=)
PAIR_OPERATOR(PairMask, >)
PAIR_OPERATOR(PairMask, >=)
#undef PAIR_OPERATOR

GSFW_FUNCTION Pair operator-(const Pair& a) { return {-a.first, -a.second}; }

GSFW_FUNCTION PairMask operator&(PairMask a, PairMask b) {
  return {a.first && b.first, a.second && b.second};
}
GSFW_FUNCTION PairMask operator|(PairMask a, PairMask b) {
  return {a.first || b.first, a.second || b.second};
}
GSFW_FUNCTION PairMask operator!(PairMask a) { return {!a.first, !a.second}; }

GSFW_FUNCTION Pair select(PairMask mask, const Pair& a, const Pair& b) {
  return {mask.first ? a.first : b.first, mask.second ? a.second : b.second};
}

#define PAIR_FUNCTION(name) \
  GSFW_FUNCTION Pair name(const Pair& a) { return {name(a.first), name(a.second)}; }
PAIR_FUNCTION(square_root)
PAIR_FUNCTION(arc_tangent)
PAIR_FUNCTION(absolute)
#undef PAIR_FUNCTION

GSFW_FUNCTION Pair minimum(const Pair& a, const Pair& b) {
  return {minimum(a.first, b.first), minimum(a.second, b.second)};
}
GSFW_FUNCTION Pair maximum(const Pair& a, const Pair& b) {
  return {maximum(a.first, b.first), maximum(a.second, b.second)};
}
GSFW_FUNCTION Pair fma(const Pair& a, const Pair& b, const Pair& c) {
  return {fma(a.first, b.first, c.first), fma(a.second, b.second, c.second)};
}

}  // namespace GSFW_ISA
}  // namespace gsfw
