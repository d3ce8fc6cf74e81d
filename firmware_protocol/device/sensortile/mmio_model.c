/* The host's side of mmio.h: tests put a model of the chip behind these two. */
#include "mmio.h"

uint32_t (*mmio_model_get)(uint32_t address);
void (*mmio_model_put)(uint32_t address, uint32_t value);
