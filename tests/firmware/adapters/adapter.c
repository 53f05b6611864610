/* The processor-in-the-loop protocol (core-nostd/src/processor_in_the_loop.rs) on standard input and output. */
#include "adapter.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define START 0x4b
#define NO_POLICY 100
#define DAMAGED 102
#define LENGTH 103

enum { POLICY = 1, RESET = 2, TICK = 3, CODE = 4, TARGETS = 5, TEST = 6 };

static uint8_t payload[65536];

static uint32_t crc32(uint32_t sum, const uint8_t *bytes, size_t len) {
  for (size_t index = 0; index < len; index++) {
    sum ^= bytes[index];
    for (int bit = 0; bit < 8; bit++) {
      sum = sum >> 1 ^ (sum & 1 ? 0xedb88320u : 0);
    }
  }
  return sum;
}

static uint32_t little_endian(const uint8_t *bytes) {
  return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

static void send(uint8_t kind, const void *bytes, uint16_t len) {
  const uint8_t head[4] = {START, kind, (uint8_t)len, (uint8_t)(len >> 8)};
  const uint32_t sum = ~crc32(crc32(UINT32_MAX, head + 1, 3), bytes, len);
  const uint8_t tail[4] = {(uint8_t)sum, (uint8_t)(sum >> 8), (uint8_t)(sum >> 16), (uint8_t)(sum >> 24)};
  fwrite(head, 1, sizeof head, stdout);
  fwrite(bytes, 1, len, stdout);
  fwrite(tail, 1, sizeof tail, stdout);
  fflush(stdout);
}

static void send_code(int32_t code) {
  const uint32_t value = (uint32_t)code;
  const uint8_t bytes[4] = {(uint8_t)value, (uint8_t)(value >> 8), (uint8_t)(value >> 16), (uint8_t)(value >> 24)};
  send(CODE, bytes, sizeof bytes);
}

/* The next frame: its kind and the length of its payload; a kind of 0 if it is damaged. Ends the program with the line. */
static uint8_t receive(uint16_t *len) {
  uint8_t head[3], tail[4];
  int byte;
  while ((byte = getchar()) != START) {
    if (byte == EOF) exit(0);
  }
  if (fread(head, 1, sizeof head, stdin) != sizeof head) exit(0);
  *len = (uint16_t)(head[1] | head[2] << 8);
  if (fread(payload, 1, *len, stdin) != *len || fread(tail, 1, sizeof tail, stdin) != sizeof tail) exit(0);
  const uint32_t sum = ~crc32(crc32(UINT32_MAX, head, sizeof head), payload, *len);
  return sum == little_endian(tail) ? head[0] : 0;
}

static void tick(uint16_t len) {
  AdapterTick request;
  static float measurements[sizeof payload / sizeof(float)];
  float speeds[4];
  if (len < sizeof request || (len - sizeof request) % sizeof(float) != 0) {
    send_code(LENGTH);
    return;
  }
  memcpy(&request, payload, sizeof request);
  memcpy(measurements, payload + sizeof request, len - sizeof request);
  const int32_t code = adapter_tick(&request, measurements, (len - sizeof request) / sizeof(float), speeds);
  if (code != 0) {
    send_code(code);
    return;
  }
  send(TARGETS, speeds, sizeof speeds);
}

int main(void) {
  int32_t code = NO_POLICY;
  send_code(NO_POLICY);
  while (true) {
    uint16_t len;
    const uint8_t kind = receive(&len);
    switch (kind) {
      case POLICY:
        code = adapter_take(payload, len);
        send_code(code);
        break;
      case RESET:
        if (code == 0) adapter_reset();
        send_code(code == 0 ? 0 : NO_POLICY);
        break;
      case TEST:
        send_code(code == 0 ? 0 : NO_POLICY);
        break;
      case TICK:
        if (code == 0) {
          tick(len);
        } else {
          send_code(NO_POLICY);
        }
        break;
      default:
        send_code(DAMAGED);
    }
  }
}
