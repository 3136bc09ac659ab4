// How long to wait before connecting again. Pure; chance is an argument.
#pragma once

namespace terraport {

/// Milliseconds to wait before an attempt (wire protocol, section 10.1): 0.5 s, then twice as long each time up to 30 s, each
/// wait multiplied by a random number in [0.5, 1], so that the clients of a restarted server do not all come back in the same
/// moment. `attempt`: 0 for the first one after the loss. `chance`: in [0, 1).
double waitMs(int attempt, double chance);

}  // namespace terraport
