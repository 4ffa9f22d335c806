// One tick of the controller in C++: what rtctl/tick.py and everything it calls compute, in the same order of
// operations. It is the reference for the speed of the compiled Python, and a second implementation for its results.
// There is a file here for each Python module and a function for each kernel; bench/layout.py writes layout.hpp.

#include <algorithm>
#include <cmath>

#include "conditions.hpp"
#include "hlc.hpp"
#include "homing.hpp"
#include "judge.hpp"
#include "lifecycle.hpp"
#include "llc.hpp"
#include "planar_3rpr.hpp"
#include "trajectory.hpp"
#include "wrench.hpp"
#include "layout.hpp"

namespace tick {
namespace {

void begin(Memory &memory, const Sensors &sensors, Record &record) {
    const Command &command = memory.command;
    State &state = memory.state;
    memory.profile.start_tick += record.missed_ticks;
    const bool valid = sensors.axes_validity == VALID;
    state.axes_silent_ticks = valid ? sensors.axes_age_ticks : state.axes_silent_ticks + 1;
    for (int i = 0; i < AXES; ++i) {
        record.axis_angle_rad[i] = sensors.axis_angle_rad[i];
        if (valid) state.angle_rad[i] = sensors.axis_angle_rad[i];
    }
    for (int i = 0; i < 6; ++i) record.wrench_in_sensor[i] = sensors.wrench_in_sensor[i];
    record.impedance_ohm = sensors.impedance_ohm;
    record.impedance_pair = sensors.impedance_pair;
    record.axes_sequence = sensors.axes_sequence;
    record.wrench_sequence = sensors.wrench_sequence;
    record.impedance_sequence = sensors.impedance_sequence;
    record.axes_age_ticks = sensors.axes_age_ticks;
    record.wrench_age_ticks = sensors.wrench_age_ticks;
    record.impedance_age_ticks = sensors.impedance_age_ticks;
    record.axes_validity = sensors.axes_validity;
    record.wrench_validity = sensors.wrench_validity;
    record.impedance_validity = sensors.impedance_validity;
    record.powered = sensors.powered;
    record.watchdog_tripped = sensors.watchdog_tripped;
    record.amplifier_fault = sensors.amplifier_fault;
    record.trouble = sensors.trouble;
    record.trouble_grade = sensors.trouble_grade;
    record.trouble_device = sensors.trouble_device;
    record.trouble_value = sensors.trouble_value;
    record.command_sequence = command.sequence;
    record.command_verb = command.verb;
    record.command_source = command.source;
    record.command_deadline_tick = command.deadline_tick;
    for (int i = 0; i < 8; ++i) record.command_argument[i] = command.argument[i];
    record.stylet_desired_mm = state.stylet_reference_mm;
    record.reason_value = record.reason_bound = NOT_KNOWN;
    record.condition_active = 0;
    record.condition_reported = -1;
    record.condition_value = record.condition_bound = NOT_KNOWN;
}

void know_pose(Memory &memory, Record &record) {
    State &state = memory.state;
    record.kinematic_iterations = 0;
    if (state.homed) {
        double angle[DOF];
        for (int i = 0; i < DOF; ++i)
            angle[i] = state.angle_rad[i] - state.home_offset_rad[i] - state.compensation_rad[i];
        record.kinematic_iterations = planar_3rpr::forward(memory.robot, angle, state.pose);
        planar_3rpr::rotation(state.pose, state.rotation);
        planar_3rpr::inverse(memory.robot, state.pose, state.joint, angle);
    }
    const bool known = state.homed && record.kinematic_iterations >= 0;
    for (int i = 0; i < DOF; ++i) {
        record.pose_measured[i] = known ? state.pose[i] : NOT_KNOWN;
        record.joint_measured[i] = known ? state.joint[i] : NOT_KNOWN;
    }
    const double stylet = state.angle_rad[DOF] - state.home_offset_rad[DOF] - state.compensation_rad[DOF];
    record.stylet_measured_mm = state.homed ? stylet * memory.parameters.stylet_lead_mm_per_rad : NOT_KNOWN;
}

void know_force(Memory &memory, const Sensors &sensors, Record &record) {
    State &state = memory.state;
    if (state.homed)
        wrench::compensate(memory.parameters, state, sensors, record);
    else
        for (int i = 0; i < 6; ++i) record.wrench_in_base[i] = NOT_KNOWN;
    const double *f = record.wrench_in_base;
    const bool planned = state.plan_number > 0;
    double axial = 0.0, squares = 0.0;
    for (int i = 0; i < 3; ++i) {
        const double axis = planned ? memory.plan.insertion_axis_in_base[i] : state.rotation[i][0];
        axial += f[i] * axis;
        squares += f[i] * f[i];
    }
    record.force_axial_n = axial;
    record.force_lateral_n =
        std::isfinite(axial) ? std::sqrt(std::max(squares - axial * axial, 0.0)) : NOT_KNOWN;
}

int64_t first_bit(int64_t bits) {
    for (int64_t i = 0; i < 63; ++i)
        if ((bits >> i) & 1) return i;
    return -1;
}

void transit(Memory &memory, int64_t before, const Record &record, int64_t setpoint_tick) {
    State &state = memory.state;
    const int64_t after = state.operating;
    if (after == before) return;
    if (after == Operating::FAULT) state.fault_cause = first_bit(record.condition_active & FAULT_MASK);
    if (after == Operating::PAUSED) {
        const int64_t interrupted = state.motion;
        hlc::brake(memory, first_bit(record.condition_active & PAUSE_MASK), setpoint_tick);
        const bool on_path = interrupted == Motion::INSERT || interrupted == Motion::RETRACT;
        state.paused_motion = on_path ? interrupted : Motion::HOLD;
    }
    if (after == Operating::FAULT || after == Operating::DISABLED || before == Operating::DISABLED) {
        hlc::hold_here(memory);
        state.unbias_left = 0;
        state.power_ticks = 0;
    }
}

void decide(Memory &memory, const Sensors &sensors, Record &record) {
    State &state = memory.state;
    const int64_t before = state.operating;
    int64_t verb = memory.command.verb, verdict = 0;
    if (verb != Verb::NONE) {
        verdict = judge::judge(memory, sensors, record);
        if (verdict != Reason::ACCEPTED) verb = Verb::NONE;
    }
    const bool retracting = state.motion == Motion::RETRACT;
    const auto [operating, judged] = lifecycle::step(before, record.condition_active, verb, retracting);
    state.operating = operating;
    if (verb != Verb::NONE) verdict = judged;
    transit(memory, before, record, state.tick - 1);
    if (verb != Verb::NONE && verdict == Reason::ACCEPTED) {
        if (verb == Verb::ACKNOWLEDGE) {
            state.latched = record.condition_active;
            state.fault_cause = -1;
        }
        hlc::obey(memory, record);
    }
    if (record.condition_active & STOP_MASK)
        hlc::brake(memory, first_bit(record.condition_active & STOP_MASK), state.tick - 1);
    record.command_verdict = int32_t(verdict);
}

void control(Memory &memory, Record &record, const double *references, double limit_v) {
    State &state = memory.state;
    const Parameters &parameters = memory.parameters;
    for (int i = 0; i < AXES; ++i) {
        const double angle = state.angle_rad[i] - state.home_offset_rad[i];
        const double command = llc::pid(parameters, state, i, references[i], angle, limit_v);
        record.axis_reference_rad[i] = references[i] + state.home_offset_rad[i];
        record.command_desired_v[i] = command;
        record.command_applied_v[i] = llc::limit(parameters, state, i, command, limit_v);
    }
}

void drive(Memory &memory, const Sensors &sensors, Record &record) {
    State &state = memory.state;
    const Parameters &parameters = memory.parameters;
    double reference[AXES];
    if (!sensors.powered || state.operating == Operating::FAULT) {
        hlc::hold_here(memory);
        for (int i = 0; i < AXES; ++i) llc::rest(state, i, state.angle_rad[i] - state.home_offset_rad[i]);
    }
    if (state.motion == Motion::HOME) {
        homing::home(memory, record, reference);
        control(memory, record, reference, parameters.homing_limit_v);
        return;
    }
    if (state.homed && sensors.powered) {
        planar_3rpr::inverse(memory.robot, state.reference, state.joint_reference, reference);
        reference[DOF] = state.stylet_reference_mm / parameters.stylet_lead_mm_per_rad;
        for (int i = 0; i < AXES; ++i) reference[i] = llc::compensate_backlash(parameters, state, i, reference[i]);
    } else {
        for (int i = 0; i < AXES; ++i) reference[i] = state.axis_reference[i];
    }
    control(memory, record, reference, parameters.command_limit_v);
}

void protect(Memory &memory, const Record &record) {
    State &state = memory.state;
    const int64_t before = state.operating;
    const bool retracting = state.motion == Motion::RETRACT;
    state.operating = lifecycle::step(before, record.condition_active, Verb::NONE, retracting).state;
    transit(memory, before, record, state.tick);
    if (record.condition_active & STOP_MASK)
        hlc::brake(memory, first_bit(record.condition_active & STOP_MASK), state.tick);
    state.active = record.condition_active;
}

void act(Memory &memory, const Sensors &sensors, Actuators &actuators, Record &record) {
    State &state = memory.state;
    const bool enabled = state.operating == Operating::ENABLED || state.operating == Operating::PAUSED;
    for (int i = 0; i < AXES; ++i) {
        const bool live = enabled && sensors.powered && std::isfinite(record.command_applied_v[i]);
        const double command = live ? record.command_applied_v[i] : 0.0;
        record.command_applied_v[i] = command;
        state.last_command_v[i] = command;
        actuators.command_v[i] = command;
    }
    state.power_ticks = enabled ? state.power_ticks + 1 : 0;
    actuators.power = enabled ? 1 : 0;
    actuators.array_loaded = uint8_t(state.array_loaded);
    record.power_request = actuators.power;
    state.latched |= record.condition_active;
}

// What the detectors of rtctl/guidance/watch.py say where there is none, the only case compared.
void leave_unwatched(Record &record) {
    for (int i = 0; i < 2; ++i) record.buckling_integral[i] = record.buckling_bound[i] = NOT_KNOWN;
    record.predicted_force_n = record.fold_decision = record.fold_bound = NOT_KNOWN;
    record.detector_samples = 0;
    record.detector_flags = 0;
}

// What rtctl/guidance/impedance/law.py says while it is off, the only case compared.
void leave_unguided(Record &record) {
    record.impedance_step_mm = record.impedance_jacobian_norm = NOT_KNOWN;
    record.impedance_offset_mm = 0.0;
    record.impedance_usable = 0;
    record.impedance_phase = 0;
}

void report(const Memory &memory, Record &record) {
    const State &state = memory.state;
    const bool known = state.homed != 0;
    for (int i = 0; i < DOF; ++i) {
        record.pose_goal[i] = known ? state.pose_goal[i] : NOT_KNOWN;
        record.pose_desired[i] = known ? state.setpoint[i] : NOT_KNOWN;
        record.pose_reference[i] = known ? state.reference[i] : NOT_KNOWN;
        record.pose_entry[i] = state.pose_entry[i];
        record.joint_reference[i] = known ? state.joint_reference[i] : NOT_KNOWN;
    }
    for (int i = 0; i < 3; ++i) record.admittance_offset_mm[i] = state.lateral_offset_mm[i];
    record.depth_mm = state.setpoint[DOF];
    record.depth_goal_mm = state.depth_goal_mm;
    record.depth_rate_mm_per_s = state.setpoint_rate[DOF];
    record.stylet_reference_mm = state.stylet_reference_mm;
    record.condition_latched = state.latched;
    record.parameter_set = int32_t(memory.parameters.number);
    record.plan_number = int32_t(state.plan_number);
    record.fault_cause = int32_t(state.fault_cause);
    record.stop_cause = int32_t(state.stop_cause);
    record.operating_state = uint8_t(state.operating);
    record.task_state = uint8_t(state.task);
    record.motion = uint8_t(state.motion);
    record.is_homed = uint8_t(state.homed);
    const bool returning = state.array_loaded == 0 && state.stylet_reference_mm > 0.0;
    record.is_busy = !hlc::is_resting(memory) || state.unbias_left > 0 || returning;
    record.is_unbiased = uint8_t(state.unbiased);
    record.array_loaded = uint8_t(state.array_loaded);
}

void tick(Memory &memory, const Sensors &sensors, Actuators &actuators, Record &record) {
    State &state = memory.state;
    state.tick = record.tick;
    begin(memory, sensors, record);
    know_pose(memory, record);
    know_force(memory, sensors, record);
    leave_unguided(record);
    conditions::watch_inputs(memory.parameters, state, sensors, record);
    leave_unwatched(record);
    decide(memory, sensors, record);
    if (state.homed && sensors.powered && state.operating != Operating::FAULT) {
        hlc::advance(memory, record);
        trajectory::correct(memory, record);
        trajectory::follow_stylet(memory, record);
        trajectory::refer(memory, record);
    }
    drive(memory, sensors, record);
    conditions::watch_outputs(memory.parameters, state, record);
    protect(memory, record);
    act(memory, sensors, actuators, record);
    report(memory, record);
}

}  // namespace
}  // namespace tick

// Run `ticks` ticks on recorded sensor frames; the first has the command in `memory`, the others none. The same as
// `drive` in bench/recorded.py.
extern "C" void drive(Memory *memory, const Sensors *sensors, Actuators *actuators, Record *records, int64_t ticks) {
    for (int64_t k = 0; k < ticks; ++k) {
        tick::tick(*memory, sensors[k], actuators[k], records[k]);
        memory->command = {};
    }
}
