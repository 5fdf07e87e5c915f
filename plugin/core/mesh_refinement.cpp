#include "core/mesh_refinement.h"
