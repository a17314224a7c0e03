
/* What the observer finds after a step. */
enum { $names, CC_CABLES = $count };

/* Nodes of a cable, from the motor to the joint. */
static inline int cc_controller_nodes(int cable)
{
    static const int nodes[CC_CABLES] = {$nodes};
    return nodes[cable];
}

/* Their tensions [N]; a negative one is slack: the cable carries nothing there. */
static inline const double *cc_controller_tensions(const cc_controller *controller,
                                                   int cable)
{
    static const int first[CC_CABLES] = {$first};
    return controller->number + first[cable];
}

/* Angle of the joint of an axis since the first step [rad]; 0 without a model. */
static inline double cc_controller_joint_angle(const cc_controller *controller,
                                               int axis)
{
    static const int place[CC_AXES] = {$joints};
    return place[axis] < 0 ? 0.0 : controller->number[place[axis]];
}
