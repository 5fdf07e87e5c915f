// In builds that watch themselves (ISOLUX_TRAP_FLOATS), what makes a NaN or divides by zero ends
// the process where it happens. Only our own threaded loops are watched: NumPy and USD count on
// quiet NaNs, and Embree's rays divide by directions that are zero.
#pragma once

#ifdef ISOLUX_TRAP_FLOATS
#include <cfenv>
#endif

namespace isolux {

#ifdef ISOLUX_TRAP_FLOATS
// Until its end, on this thread.
class FloatTraps {
  public:
    explicit FloatTraps(bool on) : before_(fegetexcept()) { set(on ? kTrapped : 0); }
    ~FloatTraps() { set(before_); }
    FloatTraps(const FloatTraps&) = delete;
    FloatTraps& operator=(const FloatTraps&) = delete;

  private:
    static constexpr int kTrapped = FE_INVALID | FE_DIVBYZERO;

    static void set(int trapped) {
        std::feclearexcept(FE_ALL_EXCEPT);
        fedisableexcept(kTrapped & ~trapped);
        feenableexcept(kTrapped & trapped);
    }

    int before_;
};
#else
struct FloatTraps {
    explicit FloatTraps(bool) {}
};
#endif

} // namespace isolux
