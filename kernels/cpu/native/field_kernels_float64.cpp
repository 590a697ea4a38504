// The kernels of temporal fields in float64, which serve all instruction sets: they are for
// accuracy.
#include "field_stages.h"
#include "grid_variation.h"
#include "hash_features.h"
#include "network.h"
#include "plane_product.h"
#include "slice.h"

namespace gsfw {
namespace GSFW_ISA {

extern const FieldKernels<double> field_float64;

const FieldKernels<double> field_float64 = {
    plane_product<double>,
    plane_product_backward<double>,
    hash_features<double>,
    hash_features_backward<double>,
    slice<double>,
    slice_backward<double>,
    grid_variation<double>,
    grid_distance<double>,
    network_scratch<double>,
    network<double>,
    network_backward<double>,
};

}  // namespace GSFW_ISA
}  // namespace gsfw
