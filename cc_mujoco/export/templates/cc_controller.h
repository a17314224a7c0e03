$mark$what. */
$comments#ifndef CC_CONTROLLER_H
#define CC_CONTROLLER_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CC_CONTROLLER_DOUBLES $memory
#define CC_CONTROLLER_PARAMETERS $parameters

/* All that a controller keeps. It is yours: static, on the stack or on the heap, with
 * the alignment of a double. Nothing is allocated, locked, printed or thrown; there is
 * no global state, so that threads may step controllers of their own. It holds no
 * pointers and may be copied. */
typedef struct {
    double number[CC_CONTROLLER_DOUBLES];
} cc_controller;

/* Axes, each with a motor. */
enum { ${axes}CC_AXES = $axis_count };

/* What is measured once a period, in SI units and with the signs of the scene. */
typedef struct {
$readings
} cc_readings;

/* Places of the parameters: meaning [unit], range. */
enum {
$indices};

/* The parameters of the scene; pass a copy with other numbers in it if you like. */
extern const double cc_controller_parameters[CC_CONTROLLER_PARAMETERS];

/* sizeof(cc_controller), of the library that is linked. */
size_t cc_controller_size(void);

/* Begin. Returns 0, or 1 + the place of the first parameter that is out of its range
 * or contradicts another; then nothing is written. */
int cc_controller_init(cc_controller *controller, const double *parameters);

/* Take other parameters from the next step on, and go on from the present state.
 * Returns as cc_controller_init; of parameters that cannot be none is taken. Call it
 * between two steps, from the thread that takes them. */
int cc_controller_set_parameters(cc_controller *controller, const double *parameters);

/* Forget the past: the next step begins an episode, at rest in the pretension. */
void cc_controller_reset(cc_controller *controller);

/* Torques of the motors (CC_AXES) [N m] until the next reading, within their limits.
 * The guard rides through a reading that is no number, infinite or beyond
 * $limit of its unit, for $ride ms; then it stops.
 * Returns 0, or 1 + the place of such a reading at which no guard looks: then all
 * torques are 0 and the state stays as it was. */
int cc_controller_step(cc_controller *controller, const cc_readings *readings,
                       double *torques);

/* Tell, after a step, what the motors got (CC_AXES) instead of these torques, where a
 * limit of yours (of rate, a soft start) allowed no more. What is no number, or beyond
 * $limit N m, is not heard. */
static inline void cc_controller_given(cc_controller *controller, const double *torques)
{
    static const int place[CC_AXES][2] = {$given};
    for (int i = 0; i < CC_AXES; i++)
        for (int k = 0; k < 2; k++)
            if (place[i][k] >= 0 && torques[i] <= $most &&
                torques[i] >= $least)
                controller->number[place[i][k]] = torques[i];
}
$observer
#ifdef __cplusplus
}
#endif
#endif
