#include "core/progressive_radiosity.h"
