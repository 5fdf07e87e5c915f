#include "binding/arrays.h"

void bind_sparse_gather(nanobind::module_&) {}
