// rtctl/lifecycle.py
#pragma once

#include "layout.hpp"

namespace lifecycle {
namespace {

bool permits(int64_t state, int64_t verb) {
    switch (verb) {
        case Verb::STOP:
        case Verb::DISABLE:
        case Verb::SET_PARAMETERS:
        case Verb::UNLOAD_ARRAY:
            return true;
        case Verb::ENABLE:
            return state == Operating::DISABLED || state == Operating::ENABLED;
        case Verb::PAUSE:
        case Verb::RETRACT:
            return state == Operating::ENABLED || state == Operating::PAUSED;
        case Verb::RESUME:
            return state == Operating::PAUSED;
        case Verb::ACKNOWLEDGE:
            return state == Operating::FAULT;
        case Verb::LOAD_PLAN:
            return state != Operating::FAULT;
        default:
            return state == Operating::ENABLED;
    }
}

struct Step {
    int64_t state, verdict;
};

Step step(int64_t state, int64_t active, int64_t verb, bool retracting) {
    int64_t verdict = 0;
    if (verb != Verb::NONE) verdict = permits(state, verb) ? Reason::ACCEPTED : Reason::WRONG_STATE;
    if (active & FAULT_MASK) {
        if (verb == Verb::ACKNOWLEDGE && state == Operating::FAULT)
            verdict = Reason::STILL_PRESENT;
        else if (verb != Verb::NONE && verb != Verb::STOP && verb != Verb::DISABLE && verb != Verb::SET_PARAMETERS &&
                 verb != Verb::UNLOAD_ARRAY)
            verdict = Reason::WRONG_STATE;
        return {Operating::FAULT, verdict};
    }
    const int64_t pausing = active & (retracting || verb == Verb::RETRACT ? RETRACTION_MASK : PAUSE_MASK);
    if (verdict == Reason::ACCEPTED) {
        if (verb == Verb::ENABLE) {
            state = Operating::ENABLED;
        } else if (verb == Verb::ACKNOWLEDGE || (verb == Verb::DISABLE && state != Operating::FAULT)) {
            state = Operating::DISABLED;
        } else if (verb == Verb::PAUSE) {
            state = Operating::PAUSED;
        } else if (verb == Verb::RESUME || verb == Verb::RETRACT) {
            if (pausing) return {Operating::PAUSED, Reason::STILL_PRESENT};
            state = Operating::ENABLED;
        }
    }
    if (state == Operating::ENABLED && pausing) {
        if (verdict == Reason::ACCEPTED && verb != Verb::ENABLE && !permits(Operating::PAUSED, verb))
            verdict = Reason::STILL_PRESENT;
        return {Operating::PAUSED, verdict};
    }
    return {state, verdict};
}

}  // namespace
}  // namespace lifecycle
