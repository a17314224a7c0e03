/* Torques of recorded readings: cc_example < readings.csv
 *
 * One line per period: $names
 * In a real-time loop the call of cc_controller_step stands between reading the sensors
 * and setting the currents of the motors; nothing else of this file does. */
#include <stdio.h>
#include <string.h>

#include "cc_controller.h"

static cc_controller controller;

int main(void)
{
    char line[$size];
    int end = 0;
    cc_readings r;
    double torques[CC_AXES];
    int wrong = cc_controller_init(&controller, cc_controller_parameters);
    if (wrong) {
        fprintf(stderr, "parameter %d cannot be %.17g\n", wrong - 1,
                cc_controller_parameters[wrong - 1]);
        return 2;
    }
    if (!fgets(line, sizeof line, stdin)) {
        fprintf(stderr, "no header on standard input\n");
        return 2;
    }
    line[strcspn(line, "\r\n")] = 0;
    if (strcmp(line, "$names")) {
        fprintf(stderr, "the header must be $names\n");
        return 2;
    }
    puts("$torques");
    for (long row = 2; fgets(line, sizeof line, stdin); row++) {
        int count = sscanf(line, "$numbers %n", $arguments, &end);
        if (count != $count || line[end]) {
            fprintf(stderr, "line %ld has not just $count numbers\n", row);
            return 2;
        }
        if (cc_controller_step(&controller, &r, torques))
            fprintf(stderr, "line %ld has a reading that cannot be\n", row);
        for (int i = 0; i < CC_AXES; i++)
            printf("%.17g%c", torques[i], i + 1 < CC_AXES ? ',' : '\n');
    }
    return 0;
}
