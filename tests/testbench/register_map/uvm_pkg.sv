// The classes of UVM 1.2 that a register model of PeakRDL-uvm uses, with their arguments and without what they do.
// A model can be elaborated against them, not run.
package uvm_pkg;
    typedef enum {UVM_NO_COVERAGE = 0} uvm_coverage_model_e;
    typedef enum {UVM_NO_ENDIAN, UVM_LITTLE_ENDIAN, UVM_BIG_ENDIAN} uvm_endianness_e;
    typedef bit [63:0] uvm_reg_addr_t;
    typedef bit [63:0] uvm_reg_data_t;
    typedef class uvm_reg;
    typedef class uvm_reg_block;

    class uvm_object;
        string name;
        function new(string name = "");
            this.name = name;
        endfunction
    endclass

    class uvm_reg_field extends uvm_object;
        function new(string name = "uvm_reg_field");
            super.new(name);
        endfunction
        function void configure(uvm_reg parent, int unsigned size, int unsigned lsb_pos, string access, bit volatile,
                                uvm_reg_data_t reset, bit has_reset, bit is_rand, bit individually_accessible);
        endfunction
    endclass

    class uvm_reg extends uvm_object;
        function new(string name, int unsigned n_bits, int has_coverage);
            super.new(name);
        endfunction
        function void configure(uvm_reg_block blk_parent, uvm_object regfile_parent = null, string hdl_path = "");
        endfunction
        virtual function void build();
        endfunction
    endclass

    class uvm_reg_map extends uvm_object;
        function new(string name = "uvm_reg_map");
            super.new(name);
        endfunction
        function void add_reg(uvm_reg rg, uvm_reg_addr_t offset, string rights = "RW", bit unmapped = 0);
        endfunction
    endclass

    class uvm_reg_block extends uvm_object;
        uvm_reg_map default_map;
        function new(string name = "", int has_coverage = UVM_NO_COVERAGE);
            super.new(name);
        endfunction
        function uvm_reg_map create_map(string name, uvm_reg_addr_t base_addr, int unsigned n_bytes,
                                        uvm_endianness_e endian, bit byte_addressing = 1);
            uvm_reg_map made = new(name);
            return made;
        endfunction
        virtual function void build();
        endfunction
    endclass
endpackage
