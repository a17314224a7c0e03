#include <math.h>

#include "cc_controller.h"

const double cc_controller_parameters[CC_CONTROLLER_PARAMETERS] = {
$rows};
