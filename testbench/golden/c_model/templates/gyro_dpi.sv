// Functions of the model that every scoreboard uses; gyro_dpi.h says what they do.
package gyro_dpi;
    import "DPI-C" function chandle gyro_dpi_open(input string block);
    import "DPI-C" function int gyro_dpi_set(input chandle model, input string name, input longint value);
    import "DPI-C" function longint gyro_dpi_number(input chandle model);
    import "DPI-C" function string gyro_dpi_name(input chandle model, input int k);
    import "DPI-C" function string gyro_dpi_values(input chandle model, input int k);

    // What differs in a clock, at most ten ports
    function automatic void report(chandle model, string block, int count);
        for (int k = 0; k < count && k < 10; k++)
            $display("clock %0d: %s: %s [dpi]", gyro_dpi_number(model), gyro_dpi_name(model, k), gyro_dpi_values(model, k));
        $display("FAIL %s: %0d ports differ at clock %0d [dpi]", block, count, gyro_dpi_number(model));
    endfunction
endpackage
