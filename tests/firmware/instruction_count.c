/* A plugin of QEMU's translator that counts how often each instruction of the guest is executed.
 *
 * Every execution of the instruction at `mark` closes a window: its counts are written and start again from zero.
 * Every instruction is counted when it is executed, so the counts are exact and the same in every run.
 *
 *   gcc -O2 -shared -fPIC -o instruction_count.so instruction_count.c
 *   qemu-system-arm … -plugin ./instruction_count.so,out=counts.txt,mark=8000400
 *
 * For QEMU 6 to 8 (plugin interface 1; QEMU 9 has another way to count). The interface is declared here, because
 * Debian's packages have no qemu-plugin.h.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))

typedef uint64_t qemu_plugin_id_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
typedef struct qemu_info_t qemu_info_t;
enum qemu_plugin_op { QEMU_PLUGIN_INLINE_ADD_U64 };
enum qemu_plugin_cb_flags { QEMU_PLUGIN_CB_NO_REGS };
typedef void (*block_callback)(qemu_plugin_id_t, struct qemu_plugin_tb *);
typedef void (*exit_callback)(qemu_plugin_id_t, void *);
typedef void (*instruction_callback)(unsigned int, void *);

void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t, block_callback);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t, exit_callback, void *);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *, size_t);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *);
void qemu_plugin_register_vcpu_insn_exec_inline(struct qemu_plugin_insn *, enum qemu_plugin_op, void *, uint64_t);
void qemu_plugin_register_vcpu_insn_exec_cb(struct qemu_plugin_insn *, instruction_callback,
                                            enum qemu_plugin_cb_flags, void *);

EXPORT int qemu_plugin_version = 1;

/* Places for instructions; a whole image has some ten thousand. */
#define SLOTS (1u << 18)

static struct {
    uint64_t address, count;
    bool used;
} slots[SLOTS];

static uint64_t mark;
static FILE *out;

static uint64_t *count_of(uint64_t address) {
    uint32_t slot = (uint32_t)(address * 0x9E3779B97F4A7C15ull >> 40) & (SLOTS - 1);
    while (slots[slot].used && slots[slot].address != address) slot = (slot + 1) & (SLOTS - 1);
    slots[slot].used = true;
    slots[slot].address = address;
    return &slots[slot].count;
}

static void close_window(unsigned int processor, void *unused) {
    (void)processor;
    (void)unused;
    fprintf(out, "window\n");
    for (uint32_t slot = 0; slot < SLOTS; slot++) {
        if (slots[slot].count == 0) continue;
        fprintf(out, "%llx %llu\n", (unsigned long long)slots[slot].address, (unsigned long long)slots[slot].count);
        slots[slot].count = 0;
    }
}

static void translated(qemu_plugin_id_t id, struct qemu_plugin_tb *block) {
    (void)id;
    for (size_t index = 0, count = qemu_plugin_tb_n_insns(block); index < count; index++) {
        struct qemu_plugin_insn *instruction = qemu_plugin_tb_get_insn(block, index);
        uint64_t address = qemu_plugin_insn_vaddr(instruction);
        if (address == mark) qemu_plugin_register_vcpu_insn_exec_cb(instruction, close_window, QEMU_PLUGIN_CB_NO_REGS, NULL);
        qemu_plugin_register_vcpu_insn_exec_inline(instruction, QEMU_PLUGIN_INLINE_ADD_U64, count_of(address), 1);
    }
}

static void finished(qemu_plugin_id_t id, void *unused) {
    (void)id;
    close_window(0, unused);
    fclose(out);
}

EXPORT int qemu_plugin_install(qemu_plugin_id_t id, const qemu_info_t *info, int argc, char **argv) {
    (void)info;
    for (int index = 0; index < argc; index++) {
        if (!strncmp(argv[index], "out=", 4)) out = fopen(argv[index] + 4, "w");
        if (!strncmp(argv[index], "mark=", 5)) mark = strtoull(argv[index] + 5, NULL, 16);
    }
    if (!out) return 1;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, finished, NULL);
    return 0;
}
