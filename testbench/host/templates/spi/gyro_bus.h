/* One frame: CS_N low, `count` bytes at SCK of 4.33 MHz, CS_N high. */
void gyro_loop_transfer(const uint8_t *sent, uint8_t *received, size_t count);
