/* The SensorTile's firmware: begin, and one turn of its loop. */
#ifndef SENSORTILE_H
#define SENSORTILE_H

#include <stdbool.h>

void sensortile_begin(void);

/* Returns whether there is more to do at once. */
bool sensortile_turn(void);

#endif
