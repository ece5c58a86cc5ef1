/* The drives as nodes of CANopen (CiA 301) with the objects of CiA 402, in place of one frame for all. They wake up
 * pre-operational and know nothing but their defaults; all they exchange is mapped by whoever leads them. A node's own
 * time-out for set-points is its master's heartbeat. */
#include "robot.h"

#include <math.h>
#include <string.h>

#define BOOTS_IN 0.02 /* s */
enum { STARTING, STOPPED = 4, OPERATIONAL = 5, PRE_OPERATIONAL = 0x7f };
enum { PDOS = 4, ENTRIES = 8, OBJECTS = 128 };
enum { NO_OBJECT = 0x06020000, READ_ONLY = 0x06010002, WRONG_LENGTH = 0x06070010, WRONG_STATE = 0x08000022 };

struct object { int index, sub, size, fixed; long value; };
static struct node {
    struct object objects[OBJECTS];
    int count, state, mode, was_powered;
    double since, heard, beat;               /* s: since its start, its master's heartbeat, its own */
    uint8_t received[PDOS][8];               /* set-points that wait for the next SYNC */
    int waiting[PDOS], syncs[PDOS];
    struct reading shown;                    /* at the last SYNC */
} nodes[JOINTS];

static const double RATED_CURRENT[JOINTS] = {6, 6, 5}; /* A */

static int id_of(int j) { return j + 1; }
static double rated_torque(int j) { return RATED_CURRENT[j] * SHEET[j].kt; }

static struct object *find(struct node *n, int index, int sub) {
    for (int i = 0; i < n->count; i++)
        if (n->objects[i].index == index && n->objects[i].sub == sub) return &n->objects[i];
    return 0;
}

static long get(struct node *n, int index, int sub) {
    struct object *o = find(n, index, sub);
    return o ? o->value : 0;
}

static void add(struct node *n, int index, int sub, int size, int fixed, long value) {
    n->objects[n->count++] = (struct object){index, sub, size, fixed, value};
}

/* The node's objects as they are after power-on. */
static void restart(int j) {
    struct node *n = &nodes[j];
    long most = lround(1000 * SHEET[j].current_limit / RATED_CURRENT[j]);
    n->count = 0;
    n->state = STARTING;
    n->mode = 0;
    n->since = n->beat = 0;
    n->heard = -1;
    memset(n->waiting, 0, sizeof n->waiting);
    const struct object fixed[] = {
        {0x1000, 0, 4, 1, 0x00020192}, {0x1018, 1, 4, 1, 0x2d}, {0x1018, 2, 4, 1, 7}, {0x1018, 3, 4, 1, 1},
        {0x1018, 4, 4, 1, 100 + j}, {0x6041, 0, 2, 1, 0}, {0x6061, 0, 1, 1, 0}, {0x6064, 0, 4, 1, 0},
        {0x2240, 0, 4, 1, 0}, {0x603F, 0, 2, 1, 0}, {0x6078, 0, 2, 1, 0}, {0x6502, 0, 4, 1, 0x280},
        {0x6075, 0, 4, 1, lround(1000 * RATED_CURRENT[j])}, {0x6076, 0, 4, 1, lround(1000 * rated_torque(j))},
        {0x1016, 1, 4, 0, 0}, {0x1017, 0, 2, 0, 0}, {0x6007, 0, 2, 0, 1}, {0x6040, 0, 2, 0, 0}, {0x6060, 0, 1, 0, 0},
        {0x6065, 0, 4, 0, 2000}, {0x6071, 0, 2, 0, 0}, {0x6072, 0, 2, 0, most}, {0x6073, 0, 2, 0, most},
        {0x607A, 0, 4, 0, 0}, {0x60C2, 1, 1, 0, 1}, {0x60C2, 2, 1, 0, -3},
    };
    for (size_t i = 0; i < sizeof fixed / sizeof fixed[0]; i++) n->objects[n->count++] = fixed[i];
    for (int k = 0; k < PDOS; k++) {
        add(n, 0x1400 + k, 1, 4, 0, 0x200 + 0x100 * k + id_of(j));
        add(n, 0x1800 + k, 1, 4, 0, 0x180 + 0x100 * k + id_of(j));
        for (int base = 0x1400; base <= 0x1800; base += 0x400) {
            add(n, base + k, 2, 1, 0, 255);
            for (int sub = 0; sub <= ENTRIES; sub++) add(n, base + 0x200 + k, sub, sub ? 4 : 1, 0, 0);
        }
    }
}

static void emergency(int j, int code) {
    node_send(j, 0x80 + id_of(j), (uint8_t[8]){code & 0xff, code >> 8, 0x11}, 8);
}

/* It leaves operation, or its master falls silent, while it is enabled: 6007. */
static void lose_connection(int j) {
    if (get(&nodes[j], 0x6007, 0) == 3) drive_quick_stop(j);
    else if (get(&nodes[j], 0x6007, 0) == 2) drive_reset(j);
}

static long value_of(int j, const struct object *o) {
    struct node *n = &nodes[j];
    switch (o->index) {
        case 0x6041: return n->shown.status;
        case 0x6061: return n->mode;
        case 0x6064: return n->shown.motor;
        case 0x2240: return n->shown.link;
        case 0x6078: return lround(1000 * n->shown.current / RATED_CURRENT[j]);
        case 0x603F: return drive[j].error == 2 ? 0x8611 : drive[j].error ? 0x8130 : 0;
        default: return o->value;
    }
}

static void written(int j, const struct object *o) {
    if (o->index == 0x6060) nodes[j].mode = o->value;
    if (o->index == 0x6040) drive_control(j, o->value);
    if (o->index == 0x607A && nodes[j].mode != 10) drive_counts(j, o->value);
    if (o->index == 0x6071 && nodes[j].mode == 10) drive_current(j, 1e-3 * o->value * RATED_CURRENT[j]);
}

static long whole(const uint8_t *p, int size) {
    unsigned long v = 0;
    for (int i = 0; i < size; i++) v |= (unsigned long)p[i] << 8 * i;
    return size == 4 ? (int32_t)v : size == 2 ? (int16_t)v : (int8_t)v;
}

static void put_whole(uint8_t *p, long v, int size) {
    for (int i = 0; i < size; i++) p[i] = v >> 8 * i & 0xff;
}

/* Why an object cannot be written; 0: it can. A mapping changes only while its PDO is off. */
static long refusal(struct node *n, const struct object *o, int size) {
    if (!o) return NO_OBJECT;
    if (o->fixed) return READ_ONLY;
    if (size != o->size) return WRONG_LENGTH;
    int mapping = o->index & ~3;
    int is_mapping = mapping == 0x1600 || mapping == 0x1A00;
    return is_mapping && !(get(n, o->index - 0x200, 1) >> 31 & 1) ? WRONG_STATE : 0;
}

static void serve(int j, const uint8_t *d) {
    struct node *n = &nodes[j];
    struct object *o = find(n, d[1] | d[2] << 8, d[3]);
    uint8_t answer[8] = {0, d[1], d[2], d[3]};
    long why = NO_OBJECT;
    if (d[0] == 0x40 && o) {
        answer[0] = 0x43 | (4 - o->size) << 2;
        put_whole(answer + 4, value_of(j, o), o->size);
        why = 0;
    } else if ((d[0] & 0xe3) == 0x23) {
        int size = 4 - (d[0] >> 2 & 3);
        why = refusal(n, o, size);
        if (!why) {
            o->value = whole(d + 4, size);
            written(j, o);
            answer[0] = 0x60;
        }
    }
    if (why) {
        answer[0] = 0x80;
        put_whole(answer + 4, why, 4);
    }
    node_send(j, 0x580 + id_of(j), answer, 8);
}

static void take_pdo(int j, int k) {
    struct node *n = &nodes[j];
    int at = 0;
    for (int sub = 1; sub <= get(n, 0x1600 + k, 0); sub++) {
        long entry = get(n, 0x1600 + k, sub);
        int size = (entry & 0xff) / 8;
        struct object *o = find(n, entry >> 16 & 0xffff, entry >> 8 & 0xff);
        if (!o || at + size > 8) return;
        o->value = whole(n->received[k] + at, size);
        at += size;
        written(j, o);
    }
}

static void send_pdo(int j, int k) {
    struct node *n = &nodes[j];
    uint8_t data[8];
    int at = 0;
    for (int sub = 1; sub <= get(n, 0x1A00 + k, 0); sub++) {
        long entry = get(n, 0x1A00 + k, sub);
        int size = (entry & 0xff) / 8;
        struct object *o = find(n, entry >> 16 & 0xffff, entry >> 8 & 0xff);
        if (!o || at + size > 8) return;
        put_whole(data + at, value_of(j, o), size);
        at += size;
    }
    if (at) node_send(j, get(n, 0x1800 + k, 1) & 0x7ff, data, at);
}

static void manage(int j, int command) {
    struct node *n = &nodes[j];
    int was = n->state;
    if (command == 0x01) n->state = OPERATIONAL;
    if (command == 0x02) n->state = STOPPED;
    if (command == 0x80) n->state = PRE_OPERATIONAL;
    if (was == OPERATIONAL && n->state != was) lose_connection(j);
    if (command == 0x81) drive_reset(j);
    if (command == 0x81 || command == 0x82) restart(j);
}

void canopen_start(void) {
    for (int j = 0; j < JOINTS; j++) {
        nodes[j].was_powered = 1;
        nodes[j].shown = read_joint(j);
        restart(j);
    }
}

void canopen_frame(int id, const uint8_t *data, int length) {
    for (int j = 0; j < JOINTS; j++) {
        struct node *n = &nodes[j];
        if (!drive[j].powered || n->state == STARTING) continue;
        if (id == 0 && length == 2 && (data[1] == 0 || data[1] == id_of(j))) manage(j, data[0]);
        else if (id == 0x700 + (get(n, 0x1016, 1) >> 16 & 0x7f)) n->heard = 0;
        else if (id == 0x600 + id_of(j) && length == 8 && n->state != STOPPED) serve(j, data);
        for (int k = 0; k < PDOS && n->state == OPERATIONAL; k++) {
            if (get(n, 0x1400 + k, 1) != id || length > 8) continue;
            memcpy(n->received[k], data, length);
            if (get(n, 0x1400 + k, 2) > 240) take_pdo(j, k);
            else n->waiting[k] = 1;
        }
    }
}

void canopen_sync(void) {
    for (int j = 0; j < JOINTS; j++) {
        struct node *n = &nodes[j];
        n->shown = read_joint(j);
        if (!drive[j].powered || n->state != OPERATIONAL) continue;
        for (int k = 0; k < PDOS; k++) {
            if (n->waiting[k]) take_pdo(j, k);
            n->waiting[k] = 0;
            int every = get(n, 0x1800 + k, 2) & 0xff, off = get(n, 0x1800 + k, 1) >> 31 & 1;
            if (off || every < 1 || every > 240 || ++n->syncs[k] < every) continue;
            n->syncs[k] = 0;
            send_pdo(j, k);
        }
    }
}

void canopen_advance(double h) {
    for (int j = 0; j < JOINTS; j++) {
        struct node *n = &nodes[j];
        if (drive[j].powered && !n->was_powered) restart(j);
        n->was_powered = drive[j].powered;
        if (!drive[j].powered) continue;
        n->since += h;
        if (n->state == STARTING && n->since >= BOOTS_IN) {
            n->state = PRE_OPERATIONAL;
            node_send(j, 0x700 + id_of(j), (uint8_t[1]){0}, 1);
        }
        double every = 1e-3 * (get(n, 0x1017, 0) & 0xffff), patience = 1e-3 * (get(n, 0x1016, 1) & 0xffff);
        n->beat += h;
        if (every > 0 && n->state != STARTING && n->beat >= every) {
            n->beat = 0;
            node_send(j, 0x700 + id_of(j), (uint8_t[1]){n->state}, 1);
        }
        if (n->heard >= 0 && patience > 0 && (n->heard += h) > patience) {
            n->heard = -1;
            emergency(j, 0x8130);
            lose_connection(j);
        }
    }
}
