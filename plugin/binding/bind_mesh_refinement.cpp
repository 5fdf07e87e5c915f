#include "binding/arrays.h"

void bind_mesh_refinement(nanobind::module_&) {}
