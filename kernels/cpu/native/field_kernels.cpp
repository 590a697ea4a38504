// The kernels of temporal fields in float32, compiled once per instruction set.
#include "field_stages.h"
#include "grid_variation.h"
#include "hash_features.h"
#include "network.h"
#include "plane_product.h"
#include "slice.h"

namespace gsfw {
namespace GSFW_ISA {

extern const FieldKernels<float> field_float32;

const FieldKernels<float> field_float32 = {
    plane_product<float>,
    plane_product_backward<float>,
    hash_features<float>,
    hash_features_backward<float>,
    slice<float>,
    slice_backward<float>,
    grid_variation<float>,
    grid_distance<float>,
    network_scratch<float>,
    network<float>,
    network_backward<float>,
};

}  // namespace GSFW_ISA
}  // namespace gsfw
