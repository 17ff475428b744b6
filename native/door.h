/* What native/build.py writes down of the kernels it compiled. */
#include <stdint.h>

typedef struct {
    const char *name;
    long level;
    void (*code)(void);
} Symbol;

extern const Symbol symbols[];   /* Ends with a name of NULL. */
extern const char digest[];      /* Of the sources that it was made from, see src/kinseek/kernels/sources.py. */
extern const char levels_built[];
extern const char rooms_built[]; /* Folders of kernels that are in it. */
extern const char made_of[];     /* All of these, for native/build.py to find in the file. */
