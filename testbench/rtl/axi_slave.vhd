-- AXI4-Lite slave of the host: single words of 32 bits in the clock clk, one write and one read under way.
--   a request that was taken waits in its registers, its READY is 0 meanwhile; a write goes before a read
--   o_write, o_fetch   access at o_address, for one clock; a write has r_wdata, a read takes word
--   o_done             the host takes the word of a read
--   SLVERR, and no access: address no multiple of 4, or some strobes but not all. No strobe: OKAY, and no access
-- Latency: 2 clocks from the edge that takes a request to the one that sees its response valid.
-- Every output to the host is a register. ARESETn is not rst; the host's AWPROT and ARPROT are not looked at.
-- VHDL-2008 (outputs are read back).
library ieee;
use ieee.std_logic_1164.all;

entity gyro_axi_slave is
    port (
        clk       : in  std_logic;
        rst       : in  std_logic;                      -- synchronous, active high
        awvalid   : in  std_logic;
        awaddr    : in  std_logic_vector(10 downto 0);  -- of a byte
        wvalid    : in  std_logic;
        wdata     : in  std_logic_vector(31 downto 0);
        wstrb     : in  std_logic_vector(3 downto 0);
        bready    : in  std_logic;
        arvalid   : in  std_logic;
        araddr    : in  std_logic_vector(10 downto 0);
        rready    : in  std_logic;
        word      : in  std_logic_vector(31 downto 0);  -- at o_address
        r_awready : out std_logic;
        r_awaddr  : out std_logic_vector(10 downto 0);
        r_wready  : out std_logic;
        r_wdata   : out std_logic_vector(31 downto 0);
        r_wstrb   : out std_logic_vector(3 downto 0);
        r_bvalid  : out std_logic;
        r_bresp   : out std_logic_vector(1 downto 0);   -- 0 OKAY, 2 SLVERR
        r_arready : out std_logic;
        r_araddr  : out std_logic_vector(10 downto 0);
        r_rvalid  : out std_logic;
        r_rdata   : out std_logic_vector(31 downto 0);
        r_rresp   : out std_logic_vector(1 downto 0);
        o_address : out std_logic_vector(10 downto 0);
        o_write   : out std_logic;
        o_fetch   : out std_logic;
        o_done    : out std_logic
    );
end entity;

architecture rtl of gyro_axi_slave is
    constant OKAY   : std_logic_vector(1 downto 0) := "00";
    constant SLVERR : std_logic_vector(1 downto 0) := "10";

    signal writes, reads, aligned, every, none : std_logic;
begin
    writes  <= not (r_awready or r_wready or r_bvalid);
    reads   <= not (r_arready or r_rvalid or writes);
    aligned <= not (o_address(1) or o_address(0));
    every   <= and r_wstrb;
    none    <= nor r_wstrb;

    o_address <= r_awaddr when writes = '1' else r_araddr;
    o_write   <= writes and aligned and every;
    o_fetch   <= reads and aligned;
    o_done    <= r_rvalid and rready;

    process (clk)
    begin
        if rising_edge(clk) then
            if rst = '1' then
                r_awready <= '1';
                r_awaddr  <= (others => '0');
                r_wready  <= '1';
                r_wdata   <= (others => '0');
                r_wstrb   <= (others => '0');
                r_bvalid  <= '0';
                r_bresp   <= OKAY;
                r_arready <= '1';
                r_araddr  <= (others => '0');
                r_rvalid  <= '0';
                r_rdata   <= (others => '0');
                r_rresp   <= OKAY;
            else
                if r_awready = '1' and awvalid = '1' then
                    r_awready <= '0';
                    r_awaddr  <= awaddr;
                end if;
                if r_wready = '1' and wvalid = '1' then
                    r_wready <= '0';
                    r_wdata  <= wdata;
                    r_wstrb  <= wstrb;
                end if;
                if bready = '1' then
                    r_bvalid <= '0';
                end if;
                if writes = '1' then
                    r_awready <= '1';
                    r_wready  <= '1';
                    r_bvalid  <= '1';
                    r_bresp   <= OKAY when aligned = '1' and (every = '1' or none = '1') else SLVERR;
                end if;
                if r_arready = '1' and arvalid = '1' then
                    r_arready <= '0';
                    r_araddr  <= araddr;
                end if;
                if rready = '1' then
                    r_rvalid <= '0';
                end if;
                if reads = '1' then
                    r_arready <= '1';
                    r_rvalid  <= '1';
                    r_rdata   <= word when aligned = '1' else (others => '0');
                    r_rresp   <= OKAY when aligned = '1' else SLVERR;
                end if;
            end if;
        end if;
    end process;
end architecture;
