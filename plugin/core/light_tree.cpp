#include "core/light_tree.h"
