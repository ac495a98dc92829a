/* One word at a byte address, over AXI4-Lite; returns the response: 0 OKAY, 2 SLVERR. */
int gyro_loop_read(uint16_t address, uint32_t *word);
int gyro_loop_write(uint16_t address, uint32_t word);
