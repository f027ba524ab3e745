/* The fastest client there is: write, poll, read, in C. It checks nothing but the length.

       floor PORT

   Takes lines from its input: a number of reads. Gives a line for each: the CPU seconds they took, then the
   seconds of each read, nan for one that was lost. */

#define _GNU_SOURCE
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

enum { PATIENCE_MS = 100, WARM_UP = 200 };

/* Read the two bytes of the present position of id 1 (RX-28 manual 3-5-1). */
static const unsigned char request[] = {0xFF, 0xFF, 0x01, 0x04, 0x02, 0x24, 0x02, 0xD2};
enum { REPLY = 8 };

static double seconds(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return t.tv_sec + t.tv_nsec * 1e-9;
}

static double one_read(int port)
{
    unsigned char reply[64];
    struct pollfd wait = {port, POLLIN, 0};
    double start = seconds(CLOCK_MONOTONIC);
    int have = 0;
    if (write(port, request, sizeof request) != sizeof request)
        return 0.0 / 0.0;
    while (have < REPLY) {
        int got = poll(&wait, 1, PATIENCE_MS) > 0 ? (int)read(port, reply, sizeof reply) : 0;
        if (got <= 0) {
            tcflush(port, TCIFLUSH);
            return 0.0 / 0.0;
        }
        have += got;
    }
    return seconds(CLOCK_MONOTONIC) - start;
}

int main(int argc, char **argv)
{
    int port = argc > 1 ? open(argv[1], O_RDWR | O_NOCTTY) : -1, count;
    struct termios raw;
    if (port < 0 || tcgetattr(port, &raw)) {
        perror("port");
        return 1;
    }
    cfmakeraw(&raw);
    tcsetattr(port, TCSANOW, &raw);
    for (int i = 0; i < WARM_UP; i++)
        one_read(port);
    printf("ready\n");
    fflush(stdout);
    while (scanf("%d", &count) == 1) {
        double *times = malloc(sizeof *times * count), before = seconds(CLOCK_PROCESS_CPUTIME_ID);
        for (int i = 0; i < count; i++)
            times[i] = one_read(port);
        printf("%.9f", seconds(CLOCK_PROCESS_CPUTIME_ID) - before);
        for (int i = 0; i < count; i++)
            printf(" %.9f", times[i]);
        printf("\n");
        fflush(stdout);
        free(times);
    }
    return 0;
}
