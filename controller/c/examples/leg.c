/* Plays a hopper in air for the program `controller`, in lock-step, or by the control law that
 * is linked in:
 *
 *     leg DOMAIN SECONDS       for `controller --domain DOMAIN`
 *     leg - SECONDS            without another process
 *
 * Prints the number of apexes, and the last command's angle in all its digits. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "leg.h"

/* 80 kg and 8 kg of added mass on a spring of 20 kN/m. */
#define GRAVITY (9.81 * 80 / 88)
#define SPRING (20000.0 / 88)
#define STEPS 20
#define H (1e-3 / STEPS)

static double x = 0, y = 2, vx = 0, vy = 0, foot_x = 0, foot_y = 0;
static bool is_down = false;
static unsigned apexes = 0;

/* One tick of a millisecond. */
static void play(const leg_command *command) {
    const double angle = command->leg_angle_rad;
    for (int step = 0; step < STEPS; step++) {
        double ax = 0, ay = -GRAVITY;
        x += vx * H / 2;
        y += vy * H / 2;
        if (!is_down && vy < 0 && y < sin(angle)) {
            is_down = true;
            foot_x = x - cos(angle);
            foot_y = y - sin(angle);
        }
        if (is_down) {
            double elongation = command->elongation_m + command->elongation_rate_m_s * step * H;
            double rest = 1 + fmin(fmax(elongation, 0), 0.2);
            double length = hypot(x - foot_x, y - foot_y);
            double pull = SPRING * (rest / length - 1);
            is_down = length < rest + 1e-9;
            if (is_down) {
                ax += pull * (x - foot_x);
                ay += pull * (y - foot_y);
            }
        }
        apexes += vy > 0 && vy + ay * H <= 0;
        vx += ax * H;
        vy += ay * H;
        x += vx * H / 2;
        y += vy * H / 2;
    }
}

int main(int argc, char **argv) {
    static leg_controller law;
    leg_session *session = NULL;
    leg_command command;
    leg_sample sample;
    char reason[512];

    if (argc != 3) {
        fprintf(stderr, "usage: %s DOMAIN|- SECONDS\n", argv[0]);
        return 2;
    }
    if (strcmp(argv[1], "-") == 0) {
        if (leg_controller_init(&law, NULL, 0, 1000, 9.81F) != 0)
            return 1;
    } else {
        session = leg_join(argv[1], 1000, 9.81F, false, 10, reason, sizeof reason);
        if (session == NULL) {
            fprintf(stderr, "%s\n", reason);
            return 1;
        }
    }
    memset(&command, 0, sizeof command);
    memset(&sample, 0, sizeof sample);
    sample.header.version = LEG_WIRE_VERSION;
    sample.header.run_id = 1;
    sample.set_point_m_s = 1;
    for (; sample.header.seq < 1000 * strtoull(argv[2], NULL, 10); sample.header.seq++) {
        unsigned flags = LEG_STATE_SENSED | LEG_CONTACT_SENSED;
        sample.header.flags = (uint16_t)(flags | (is_down ? LEG_IN_CONTACT : 0U));
        sample.header.t_ns = sample.header.seq * 1000000;
        sample.vx_m_s = (float)vx;
        sample.y_m = (float)y;
        sample.vy_m_s = (float)vy;
        if (session == NULL) {
            leg_controller_step(&law, &sample, &command);
        } else if (leg_exchange(session, &sample, 10, &command) != 1) {
            fprintf(stderr, "the controller does not answer\n");
            leg_leave(session);
            return 1;
        }
        play(&command);
    }
    if (session != NULL) {
        sample.header.flags = LEG_END;
        leg_send(session, &sample);
        leg_leave(session);
    }
    printf("%u apexes, %.9g rad, %.17g m/s\n", apexes, (double)command.leg_angle_rad, vx);
    return 0;
}
