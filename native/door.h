/* The table of compiled kernels that native/build.py writes. */
#include <stdint.h>

typedef struct {
    const char *name;
    long level;
    void (*code)(void);
} Symbol;

extern const Symbol symbols[];   /* Ends with a name of NULL. */
extern const char digest[];      /* Digest of its sources, see src/kinseek/kernels/sources.py. */
extern const char levels_built[];
extern const char rooms_built[]; /* Folders of kernels in the library. */
extern const char made_of[];     /* All of these; native/build.py looks for it in the file. */
