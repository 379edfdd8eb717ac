// Reads the FLASER lines of a CARMEN log, counts hits and passes along Bresenham's lines on a grid
// that holds all beams, and writes what is occupied as a pgm. Checks nothing: it is what a quick
// program does. Usage: count_beams LOG OUT.pgm
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

struct Beam {
    double x, y, u, v;
};

int main(int, char **words) {
    const double resolution = 0.05, range_max = 30.0, ratio = 0.3;
    std::ifstream file(words[1]);
    std::string line;
    std::vector<Beam> beams;
    std::vector<double> ranges;
    double left = 1e300, low = 1e300, right = -1e300, high = -1e300;
    while (std::getline(file, line)) {
        if (line.compare(0, 7, "FLASER ") != 0) continue;
        char *at;
        const long count = std::strtol(line.c_str() + 7, &at, 10);
        ranges.resize(count);
        for (double &range : ranges) range = std::strtod(at, &at);
        const double x = std::strtod(at, &at), y = std::strtod(at, &at), yaw = std::strtod(at, &at);
        for (long k = 0; k < count; k++) {
            if (!(ranges[k] > 0 && ranges[k] < range_max)) continue;
            const double angle = yaw - M_PI / 2 + k * (M_PI / 180);
            const double u = x + ranges[k] * std::cos(angle), v = y + ranges[k] * std::sin(angle);
            beams.push_back({x, y, u, v});
            left = std::min({left, x, u}), right = std::max({right, x, u});
            low = std::min({low, y, v}), high = std::max({high, y, v});
        }
    }
    const auto cell = [=](double value) { return (long)std::floor(value / resolution); };
    const long first_col = cell(left) - 2, first_row = cell(low) - 2;
    const long width = cell(right) + 3 - first_col, height = cell(high) + 3 - first_row;
    std::vector<int32_t> hits(width * height), passes(width * height);
    for (const Beam &beam : beams) {
        long col = cell(beam.x) - first_col, row = cell(beam.y) - first_row;
        const long last_col = cell(beam.u) - first_col, last_row = cell(beam.v) - first_row;
        const long along = std::labs(last_col - col), up = std::labs(last_row - row);
        const long step_col = col < last_col ? 1 : -1, step_row = row < last_row ? 1 : -1;
        long error = along - up;
        while (col != last_col || row != last_row) {
            passes[row * width + col]++;
            const long twice = 2 * error;
            if (twice > -up) error -= up, col += step_col;
            if (twice < along) error += along, row += step_row;
        }
        hits[row * width + col]++;
    }
    std::vector<unsigned char> pixels(width * height);
    for (long row = 0; row < height; row++)
        for (long col = 0; col < width; col++) {
            const long k = row * width + col, visits = hits[k] + passes[k];
            const int value = visits == 0 ? 205 : hits[k] > ratio * visits ? 0 : 254;
            pixels[(height - 1 - row) * width + col] = (unsigned char)value;
        }
    std::FILE *out = std::fopen(words[2], "wb");
    std::fprintf(out, "P5\n%ld %ld\n255\n", width, height);
    std::fwrite(pixels.data(), 1, pixels.size(), out);
    return std::fclose(out);
}
