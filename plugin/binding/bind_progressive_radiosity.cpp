#include "binding/arrays.h"

void bind_progressive_radiosity(nanobind::module_&) {}
