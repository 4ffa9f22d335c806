/* Port instructions for drivers/sensoray526/native.py: one call carries out a whole batch (hal.seams.OPERATION).
 *
 * The right to use ports belongs to a thread: those made later inherit it, others do not, and an access without it is a
 * segmentation fault. So every thread asks for its own before its first access.
 *
 * With RTCTL_PORTS_IN_MEMORY the accesses go to an array, for tests on machines without such a card.
 */

#include <errno.h>
#include <stdint.h>

enum kind { READ = 0, WRITE = 1, POLL = 2 };

struct operation {
    int32_t kind, port, value, mask, limit, result;
};

#ifdef RTCTL_PORTS_IN_MEMORY

uint16_t rtctl_ports_memory[0x8000];
uint32_t rtctl_ports_accesses;

static uint16_t read_port(uint16_t port)
{
    rtctl_ports_accesses++;
    return rtctl_ports_memory[port >> 1];
}

static void write_port(uint16_t word, uint16_t port)
{
    rtctl_ports_accesses++;
    rtctl_ports_memory[port >> 1] = word;
}

int rtctl_ports_refusal; /* errno with which a right is refused, 0 to grant it */

static int permit(unsigned long base, unsigned long size, int on)
{
    (void)base, (void)size;
    errno = rtctl_ports_refusal;
    return on && rtctl_ports_refusal ? -1 : 0;
}

#else

#include <sys/io.h>

static uint16_t read_port(uint16_t port) { return inw(port); }
static void write_port(uint16_t word, uint16_t port) { outw(word, port); }
static int permit(unsigned long base, unsigned long size, int on) { return ioperm(base, size, on); }

#endif

#define CARDS 1024 /* one for each address of 0x40 */

static _Thread_local uint8_t permitted[CARDS];

/* 0, or the errno of the system. */
int rtctl_ports_acquire(int32_t base, int32_t size)
{
    if (permit((unsigned long)base, (unsigned long)size, 1) != 0)
        return errno;
    permitted[base / 0x40] = 1;
    return 0;
}

void rtctl_ports_release(int32_t base, int32_t size)
{
    permit((unsigned long)base, (unsigned long)size, 0);
    permitted[base / 0x40] = 0;
}

/* How many POLLs timed out. Nothing was done if it is -1: this thread may not use the ports; or -2 - n: operation n is of
 * no kind, or its port is odd or not on the card. */
int rtctl_ports_execute(struct operation *operations, int32_t count, int32_t base, int32_t size)
{
    int timed_out = 0;

    if (!permitted[base / 0x40] && rtctl_ports_acquire(base, size) != 0)
        return -1;
    for (int32_t n = 0; n < count; n++) {
        int32_t offset = operations[n].port - base;
        if (offset < 0 || offset >= size || offset & 1 || operations[n].kind < READ || operations[n].kind > POLL)
            return -2 - n;
    }
    for (struct operation *o = operations; o < operations + count; o++) {
        uint16_t port = (uint16_t)o->port;
        if (o->kind == READ) {
            o->result = read_port(port);
        } else if (o->kind == WRITE) {
            write_port((uint16_t)o->value, port);
        } else {
            o->result = -1;
            for (int32_t tries = 0; tries < o->limit; tries++) {
                uint16_t word = read_port(port);
                if ((word & o->mask) == o->value) {
                    o->result = word;
                    break;
                }
            }
            timed_out += o->result < 0;
        }
    }
    return timed_out;
}
