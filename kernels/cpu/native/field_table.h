// The table of a temporal field's kernels for one type of number.
#pragma once

#include "field_stages.h"
#include "grid_variation.h"
#include "hash_features.h"
#include "network.h"
#include "plane_product.h"
#include "slice.h"

namespace gsfw {
namespace GSFW_ISA {

template <typename T>
constexpr FieldKernels<T> FIELD_KERNELS = {
    plane_product<T>,
    plane_product_backward<T>,
    hash_features<T>,
    hash_features_backward<T>,
    slice<T>,
    slice_backward<T>,
    grid_variation<T>,
    grid_distance<T>,
    network_scratch<T>,
    network<T>,
    network_backward<T>,
};

}  // namespace GSFW_ISA
}  // namespace gsfw
