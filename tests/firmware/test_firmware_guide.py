"""What docs/sensortile.md adds to ST's project compiles against encoder and device as they are."""

import re
import subprocess
from pathlib import Path

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
"""


def test_the_file_for_the_project_compiles_without_a_warning(compiler, tmp_path):
    (tmp_path / "SensorTile.h").write_text(STUBS)
    command = [compiler, "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only"]
    command += [f"-I{tmp_path}", f"-I{PROTOCOL / 'encoder'}", f"-I{PROTOCOL / 'device'}", str(GLUE)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


def test_the_files_that_the_guide_names_are_there_and_complete():
    named = set(re.findall(r"`(\w+)\.c`", GUIDE))
    there = {path.stem for path in (PROTOCOL / "device").glob("*.c")}
    boards = {name for name in there if name.startswith("board_")}
    assert named | boards == there
