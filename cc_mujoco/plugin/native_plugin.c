/* Registration of the plugin, after its functions. The constants CC_* come before. */

Engine engine;
Layout written_layout;
CC_EXPORT int64_t cc_mujoco_said[CC_DIGEST_SLOTS];

typedef struct {
    const char *name;
    int nattribute;
    const char *const *attributes;
    int capabilityflags;
    int needstage;
    int (*nstate)(int64_t, int32_t);
    void *nsensordata;
    int (*init)(int64_t, int64_t, int32_t);
    void (*destroy)(int64_t, int32_t);
    void *copy;
    void (*reset)(int64_t, int64_t, int64_t, int32_t);
    void (*compute)(int64_t, int64_t, int32_t, int32_t);
    void (*advance)(int64_t, int64_t, int32_t);
    void *visualize;
    void *actuator_act_dot;
    void *sdf_distance;
    void *sdf_gradient;
    void *sdf_staticdistance;
    void *sdf_attribute;
    void *sdf_aabb;
} PluginRecord;

typedef void (*Address)(void);

enum { ENGINE_COUNT = sizeof(Engine) / sizeof(Address) + 3 };

/* Clock that stands still, for `mjcb_time`. */
CC_EXPORT double cc_mujoco_stopped_clock(void) { return 0.0; }

/* Take MuJoCo's functions, in the order of `CC_ENGINE_NAMES`. */
CC_EXPORT void cc_mujoco_use_engine(const Address *found)
{
    memcpy(&engine, found, sizeof engine);
}

/* Offsets and sizes in MuJoCo's structures, in the order of `Layout`. */
CC_EXPORT const char cc_mujoco_layout[] = CC_LAYOUT_PATHS;
/* Values of MuJoCo's constants that the functions were compiled with. */
CC_EXPORT const char cc_mujoco_enumerators[] = CC_ENUMERATORS;

/* Take the offsets of MuJoCo's structures from a host that knows them. */
CC_EXPORT void cc_mujoco_use_layout(const int64_t *found)
{
    memcpy(&written_layout, found, sizeof written_layout);
}

/* Return whether the offsets for this version of MuJoCo are known, and take them. */
static bool find_layout(int version)
{
    for (size_t i = 0; i < sizeof known_layouts / sizeof known_layouts[0]; i++) {
        if (known_layouts[i].version == version) {
            written_layout = known_layouts[i].layout;
            return true;
        }
    }
    return false;
}

/* Register the plugin; return MuJoCo's number of it, or -1 for an unknown version. */
CC_EXPORT int cc_mujoco_register(const Address *found)
{
    static const char *const keys[] = {CC_KEYS};
    static PluginRecord record;
    int (*version)(void);
    int (*put)(const PluginRecord *);
    void (*warning)(const char *, ...);
    cc_mujoco_use_engine(found);
    memcpy(&version, &found[ENGINE_COUNT - 3], sizeof version);
    memcpy(&put, &found[ENGINE_COUNT - 2], sizeof put);
    memcpy(&warning, &found[ENGINE_COUNT - 1], sizeof warning);
    if (layout.mjModel_nv == 0 && !find_layout(version())) {
        warning(CC_OTHER_VERSION);
        return -1;
    }
    record.name = CC_PLUGIN;
    record.nattribute = sizeof keys / sizeof keys[0];
    record.attributes = keys;
    record.capabilityflags = CC_CAPABILITIES;
    record.needstage = CC_STAGE;
    record.nstate = cc_mujoco_nstate;
    record.init = cc_mujoco_init;
    record.destroy = cc_mujoco_destroy;
    record.reset = cc_mujoco_reset;
    record.compute = cc_mujoco_compute;
    record.advance = cc_mujoco_advance;
    return put(&record);
}

#if CC_LOADS_ITSELF
/* A host in C loads the library; Python gives MuJoCo's functions to the one it uses. */
#if defined(_WIN32)
#include <windows.h>
static Address find(const char *name)
{
    HMODULE module = GetModuleHandleA("mujoco.dll");
    return module == NULL ? NULL : (Address)GetProcAddress(module, name);
}
BOOL WINAPI DllMain(HINSTANCE instance, DWORD reason, LPVOID reserved);
#else
#include <dlfcn.h>
#if defined(__APPLE__)
#include <mach-o/dyld.h>
#else
#include <link.h>
#endif

/* Handle of the MuJoCo library in this process, which its host may have loaded for
   itself alone, as Python does. */
static void *mujoco_library;

static void look_at(const char *file)
{
    if (mujoco_library == NULL && file != NULL && strstr(file, "libmujoco") != NULL) {
        mujoco_library = dlopen(file, RTLD_LAZY | RTLD_NOLOAD);
    }
}

#if defined(__APPLE__)
static void find_library(void)
{
    for (uint32_t i = 0; i < _dyld_image_count(); i++) {
        look_at(_dyld_get_image_name(i));
    }
}
#else
static int look_at_object(struct dl_phdr_info *about, size_t size, void *data)
{
    (void)size;
    (void)data;
    look_at(about->dlpi_name);
    return 0;
}

static void find_library(void) { (void)dl_iterate_phdr(look_at_object, NULL); }
#endif

static Address find(const char *name)
{
    Address found = NULL;
    void *symbol = dlsym(RTLD_DEFAULT, name);
    if (symbol == NULL && mujoco_library == NULL) {
        find_library();
    }
    if (symbol == NULL && mujoco_library != NULL) {
        symbol = dlsym(mujoco_library, name);
    }
    memcpy(&found, &symbol, sizeof found);
    return found;
}
#endif

static void load(void)
{
    static const char *const engine_names[ENGINE_COUNT] = {CC_ENGINE_NAMES};
    Address found[ENGINE_COUNT];
    for (int i = 0; i < ENGINE_COUNT; i++) {
        found[i] = find(engine_names[i]);
        if (found[i] == NULL) {
            return;
        }
    }
    (void)cc_mujoco_register(found);
}

#if defined(_WIN32)
BOOL WINAPI DllMain(HINSTANCE instance, DWORD reason, LPVOID reserved)
{
    (void)instance;
    (void)reserved;
    if (reason == DLL_PROCESS_ATTACH) {
        load();
    }
    return TRUE;
}
#else
__attribute__((constructor)) static void cc_mujoco_load(void) { load(); }
#endif
#endif
