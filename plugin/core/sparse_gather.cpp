#include "core/sparse_gather.h"
