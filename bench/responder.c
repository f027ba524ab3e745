/* A servo that answers as soon as it is asked, or a set time later, on a pseudo terminal.

       responder [device delay in microseconds]

   It prints the name of the terminal and then answers until it is ended. Both protocols are told apart by
   their header: Dynamixel 1.0 (FF FF; RX-28 manual 3-2, 3-5) and LX-16A (55 55; protocol document, 2 to 4).
   It answers for every id, to reads and PINGs alone, and keeps nothing that is written to it. */

#define _GNU_SOURCE
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

enum { BROADCAST = 254, DXL_PING = 1, DXL_READ = 2, LX_POSITION = 28 };
enum { TABLE = 256, SPIN_NS = 80000 };

static unsigned char table[TABLE];

static long long now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

/* Sleep for most of the time and spin for the rest: a sleep alone ends some tens of microseconds late. */
static void wait_until(long long end)
{
    long long rest = end - now_ns() - SPIN_NS;
    if (rest > 0) {
        struct timespec t = {rest / 1000000000LL, rest % 1000000000LL};
        nanosleep(&t, NULL);
    }
    while (now_ns() < end)
        ;
}

static unsigned char checksum(const unsigned char *packet, int size)
{
    unsigned sum = 0;
    for (int i = 2; i < size - 1; i++)
        sum += packet[i];
    return (unsigned char)~sum;
}

/* Length of the packet that starts here; 0 if more bytes are needed, -1 if none starts here. */
static int packet_size(const unsigned char *bytes, int have)
{
    static const unsigned char dxl[] = {0xFF, 0xFF}, lx[] = {0x55, 0x55};
    int head = have < 2 ? have : 2;
    int is_dxl = memcmp(bytes, dxl, head) == 0, is_lx = memcmp(bytes, lx, head) == 0;
    if (!is_dxl && !is_lx)
        return -1;
    if (have < 4)
        return have > 2 && bytes[2] == 0xFF ? -1 : 0;
    if (bytes[2] == 0xFF || bytes[3] < 2)
        return -1;
    int size = bytes[3] + (is_dxl ? 4 : 3);
    if (have < size)
        return 0;
    return bytes[size - 1] == checksum(bytes, size) ? size : -1;
}

/* How many bytes the LX-16A gives to a command that reads (protocol document, section 4). */
static int lx_answers(int command)
{
    switch (command) {
    case 2: case 8: case 21: case 23: case 30: return 4;
    case 27: case LX_POSITION: return 2;
    case 14: case 19: case 25: case 26: case 32: case 34: case 36: return 1;
    default: return 0;
    }
}

/* Build the reply to a request; gives its length, 0 if there is none. */
static int answer(const unsigned char *request, unsigned char *reply)
{
    int id = request[2], command = request[4], count, size;
    if (id == BROADCAST)
        return 0;
    memcpy(reply, request, 3);
    if (request[0] == 0xFF) {
        if (command != DXL_PING && command != DXL_READ)
            return 0;
        count = command == DXL_READ ? request[6] : 0;
        if (command == DXL_READ && request[5] + count > TABLE)
            return 0;
        reply[3] = (unsigned char)(count + 2);
        reply[4] = 0; /* no error */
        memcpy(reply + 5, table + (command == DXL_READ ? request[5] : 0), count);
    } else {
        count = lx_answers(command);
        if (count == 0)
            return 0;
        reply[3] = (unsigned char)(count + 3);
        reply[4] = (unsigned char)command;
        memset(reply + 5, 0, count);
        if (command == LX_POSITION)
            memcpy(reply + 5, table + 36, 2);
    }
    size = 6 + count;
    reply[size - 1] = checksum(reply, size);
    return size;
}

static int open_terminal(void)
{
    int master = posix_openpt(O_RDWR | O_NOCTTY), slave;
    struct termios raw;
    if (master < 0 || grantpt(master) || unlockpt(master) || (slave = open(ptsname(master), O_RDWR | O_NOCTTY)) < 0) {
        perror("pseudo terminal");
        exit(1);
    }
    tcgetattr(slave, &raw); /* and stays open, so that the terminal survives clients that come and go */
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw);
    return master;
}

int main(int argc, char **argv)
{
    long long delay = argc > 1 ? atoll(argv[1]) * 1000 : 0;
    unsigned char heard[1024], reply[TABLE + 8];
    int have = 0, master = open_terminal();
#ifdef __linux__
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    prctl(PR_SET_TIMERSLACK, 1);
#endif
    table[0] = 28; /* model number of the RX-28 */
    table[36] = 0x00, table[37] = 0x02; /* present position 512 */
    printf("%s\n", ptsname(master));
    fflush(stdout);
    for (;;) {
        int got = (int)read(master, heard + have, sizeof heard - have), size, at = 0;
        long long arrived = delay ? now_ns() : 0;
        if (got <= 0)
            return 1;
        have += got;
        while (at < have && (size = packet_size(heard + at, have - at)) != 0) {
            int length = size > 0 ? answer(heard + at, reply) : 0;
            at += size > 0 ? size : 1;
            if (length == 0)
                continue;
            if (delay)
                wait_until(arrived + delay);
            if (write(master, reply, length) != length)
                return 1;
        }
        memmove(heard, heard + at, have -= at);
        if (have == sizeof heard)
            have = 0;
    }
}
