using System;
using System.Reflection;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>Bytes that a call allocates on this thread, by the runtime's own count.</summary>
    internal static class Allocations
    {
        private static object kept;

        /// <summary>Bytes over many calls, after some that make buffers large enough. Ends the test as ignored where nobody counts.</summary>
        internal static long Of(int calls, Action call)
        {
            Func<long> allocated = Counter();
            for (int at = 0; at < 20; at++)
            {
                call();
            }
            long before = allocated();
            for (int at = 0; at < calls; at++)
            {
                call();
            }
            return allocated() - before;
        }

        /// <summary>Mono's count is exact; Unity's runtime has none.</summary>
        private static Func<long> Counter()
        {
            // By reflection: Unity's class libraries may lack it.
            MethodInfo method = typeof(GC).GetMethod("GetAllocatedBytesForCurrentThread");
            var count = method == null ? null : (Func<long>)Delegate.CreateDelegate(typeof(Func<long>), method);
            long before = count == null ? 0 : count();
            kept = new byte[100];
            if (count == null || count() - before < 100)
            {
                Assert.Ignore("this runtime does not count allocations" + (kept == null ? "." : ""));
            }
            return count;
        }
    }
}
