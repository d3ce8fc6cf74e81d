"""What docs/sensortile.md adds to ST's project fits encoder and device, and loses no byte."""

import re
import subprocess
from pathlib import Path

import pytest

from allanscope.wire import WireSettings, format_named

ROOT = Path(__file__).parents[2]
GUIDE = (ROOT / "docs" / "sensortile.md").read_text()
PROTOCOL = ROOT / "firmware_protocol"
GLUE = PROTOCOL / "st_project" / "monitor.c"

# What ST's board support and USB stack declare, as far as the file uses it.
STUBS = """
#include <stdbool.h>
#include <stdint.h>
enum { COMPONENT_OK, USBD_OK = 0, USBD_STATE_CONFIGURED = 3 };
typedef struct { int dev_state; void *pClassData; } USBD_HandleTypeDef;
extern USBD_HandleTypeDef USBD_Device;
uint8_t Sensor_IO_SPI_Write(void *handle, uint8_t reg, uint8_t *from, uint16_t n);
uint8_t Sensor_IO_SPI_Read(void *handle, uint8_t reg, uint8_t *to, uint16_t n);
void HAL_Delay(uint32_t ms);
uint8_t USBD_CDC_SetTxBuffer(USBD_HandleTypeDef *device, uint8_t *from, uint16_t n);
uint8_t USBD_CDC_TransmitPacket(USBD_HandleTypeDef *device);
uint8_t USBD_CDC_ReceivePacket(USBD_HandleTypeDef *device);
uint32_t __get_PRIMASK(void);
void __set_PRIMASK(uint32_t mask);
void __disable_irq(void);
"""

# A part whose FIFO gets a sample each period, a USB stack whose transfers end when the host reads.
RUN = r"""
#include <stdio.h>
#include <string.h>
#include "monitor.c"
enum { PERIOD_US = 9615, FIFO_WORDS = 9 };
USBD_HandleTypeDef USBD_Device = {USBD_STATE_CONFIGURED, 0};
static uint8_t registers[128], *from_ring;
static uint16_t in_transfer, sample;
static uint64_t now;
static int waiting, word;
static bool sending;
uint64_t time_us(void) { return now; }
uint32_t random_number(void) { return 7; }
void received_put(uint8_t byte) { (void)byte; }
int received_take(void) { return -1; }
void HAL_Delay(uint32_t ms) { now += 1000 * ms; }
uint32_t __get_PRIMASK(void) { return 0; }
void __set_PRIMASK(uint32_t mask) { (void)mask; }
void __disable_irq(void) {}
uint8_t Sensor_IO_SPI_Write(void *handle, uint8_t reg, uint8_t *from, uint16_t n)
{
    (void)handle, (void)n;
    registers[reg] = *from;
    if (reg == 0x12 && (*from & 1)) memset(registers, 0, sizeof registers);
    return COMPONENT_OK;
}
static uint8_t fifo_byte(bool high)
{
    uint16_t value = (uint16_t)(0x1122 + sample);
    if (word == 6) value = (uint16_t)((sample * 384u >> 8 & 0xff) | (sample * 384u >> 16) << 8);
    if (word == 7) value = (uint16_t)((sample * 384u & 0xff) << 8);
    if (!high && waiting > 0) waiting--;
    uint8_t byte = (uint8_t)(high ? value >> 8 : value);
    if (high && ++word == FIFO_WORDS) word = 0, sample++;
    return byte;
}
uint8_t Sensor_IO_SPI_Read(void *handle, uint8_t reg, uint8_t *to, uint16_t n)
{
    (void)handle;
    registers[0x0f] = 0x6a;
    for (uint16_t i = 0; i < n; i++) {
        const uint8_t at = (uint8_t)(reg + i);
        to[i] = reg == 0x3e  ? fifo_byte(i & 1)
                : at == 0x3a ? (uint8_t)waiting
                : at == 0x3b ? (uint8_t)(waiting >> 8 | (waiting ? 0 : 0x10))
                : at == 0x3c ? (uint8_t)word
                : at == 0x3d ? 0
                             : registers[at];
    }
    return COMPONENT_OK;
}
uint8_t USBD_CDC_SetTxBuffer(USBD_HandleTypeDef *device, uint8_t *from, uint16_t n)
{
    (void)device;
    from_ring = from, in_transfer = n;
    return USBD_OK;
}
uint8_t USBD_CDC_TransmitPacket(USBD_HandleTypeDef *device)
{
    (void)device;
    if (sending) return 1;
    sending = true;
    return USBD_OK;
}
uint8_t USBD_CDC_ReceivePacket(USBD_HandleTypeDef *device) { (void)device; return USBD_OK; }
static void turns(int count, bool reading)
{
    for (int i = 0; i < count; i++) {
        now += PERIOD_US;
        if (waiting < 2000) waiting += FIFO_WORDS;
        monitor_poll();
        if (reading && sending) {
            fwrite(from_ring, 1, in_transfer, stdout);
            sending = false;
            usb_sent();
        }
        if (as_ring_waiting(&ring) > sizeof ring_bytes) printf("too many wait");
    }
}
int main(int count, char **given)
{
    monitor_init(0);
    monitor_opened();
    turns(200, true);
    turns(count > 1 ? atoi(given[1]) : 0, false); /* the host stops reading: one transfer stays */
    turns(1, true); /* it ends, and all that has waited is the next one */
    turns(10, false);
    monitor_opened();
    turns(400, true);
    return 0;
}
"""


def test_the_file_for_the_project_compiles_without_a_warning(compiler, tmp_path):
    (tmp_path / "SensorTile.h").write_text(STUBS)
    command = [compiler, "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only"]
    command += [f"-I{tmp_path}", f"-I{PROTOCOL / 'encoder'}", f"-I{PROTOCOL / 'device'}", str(GLUE)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize("stopped", [0, 3, 6000])
def test_a_host_that_stops_reading_and_opens_again_costs_what_had_no_room(
    compiler, tmp_path, stopped
):
    """Its last transfer ends after the queue was thrown away with what it had been part of."""
    (tmp_path / "SensorTile.h").write_text("#include <stdlib.h>\n" + STUBS)
    (tmp_path / "run.c").write_text(RUN)
    device = PROTOCOL / "device"
    names = ("lsm6dsm", "lsm6dsm_self_test", "imu", "device", "descriptor")
    sources = [*(device / f"{name}.c" for name in names), *(PROTOCOL / "encoder").glob("*.c")]
    folders = [f"-I{at}" for at in (tmp_path, GLUE.parent, PROTOCOL / "encoder", device)]
    out = tmp_path / "run"
    command = [compiler, "-std=c99", "-O1", *folders, "-o", str(out), str(tmp_path / "run.c")]
    subprocess.run([*command, *map(str, sources), "-lm"], check=True)
    sent = subprocess.run([out, str(stopped)], capture_output=True, check=True, timeout=60).stdout
    decoder = format_named("native").decoder(WireSettings())
    for at in range(0, len(sent), 100):
        decoder.feed(sent[at : at + 100], at)
    stats = decoder.stats
    assert stats.crc_errors <= 1
    assert b"too many wait" not in sent
    assert 590 <= stats.samples <= 620 + stopped
    assert 600 + stopped <= stats.samples + stats.lost_samples <= 611 + stopped


def test_the_files_that_the_guide_names_are_there_and_complete():
    named = set(re.findall(r"`(\w+)\.c`", GUIDE))
    there = {path.stem for path in (PROTOCOL / "device").glob("*.c")}
    boards = {name for name in there if name.startswith("board_")}
    assert named | boards == there
