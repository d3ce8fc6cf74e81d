"""The C of docs/sensortile.md compiles against the encoder and the device as they are."""

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
GUIDE = (ROOT / "docs" / "sensortile.md").read_text()

# What ST's board support and USB stack declare, as far as the guide uses it.
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
uint32_t random_number(void);
uint64_t time_us(void);
void received_put(uint8_t byte);
int received_take(void);
void monitor_init(void *handle);
void monitor_poll(void);
void usb_sent(void);
void usb_reset(void);
static void usb_send(void);
"""


def test_the_code_of_the_guide_compiles_without_a_warning(compiler, tmp_path):
    blocks = re.findall(r"^```c\n(.*?)^```", GUIDE, re.M | re.S)
    assert len(blocks) == 4
    (tmp_path / "SensorTile.h").write_text(STUBS)
    (tmp_path / "guide.c").write_text("\n".join(blocks))
    protocol = ROOT / "firmware_protocol"
    command = [compiler, "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only"]
    command += ["-Wno-unused-function", f"-I{tmp_path}", f"-I{protocol / 'encoder'}"]
    command += [f"-I{protocol / 'device'}", str(tmp_path / "guide.c")]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


def test_the_files_that_the_guide_names_are_there_and_complete():
    device = ROOT / "firmware_protocol" / "device"
    named = set(re.findall(r"`(\w+)\.c`", GUIDE))
    there = {path.stem for path in device.glob("*.c")}
    boards = {name for name in there if name.startswith("board_")}
    assert named | boards == there
