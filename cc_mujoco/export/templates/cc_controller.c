/* $what. */
#include "cc_controller.h"

#include "cc_native.h"

$functions
$tables

size_t cc_controller_size(void) { return sizeof(cc_controller); }

int cc_controller_set_parameters(
    cc_controller *controller, const double *given)
{
    double *memory = controller->number;
    int64_t wrong = 0;
$checks
$stores
    return 0;
}

void cc_controller_reset(cc_controller *controller)
{
$restarts
}

int cc_controller_init(cc_controller *controller, const double *given)
{
    const int wrong = cc_controller_set_parameters(controller, given);
    if (wrong == 0) {
        cc_controller_reset(controller);
    }
    return wrong;
}

int cc_controller_step(cc_controller *controller,
                       const cc_readings *readings, double *torques)
{
    double *memory = controller->number;
    double seen[sizeof(cc_readings) / sizeof(double)];
    memcpy(seen, readings, sizeof seen);
    int64_t wrong = $wrong
$own    if (wrong != 0) {
$nothing
        return (int)wrong;
    }
$steps
    return 0;
}
