using System;

namespace UnityEngine
{
    /// <summary>Marks what Unity does not have: for tests to look into what the stubs were given.</summary>
    [AttributeUsage(AttributeTargets.Method | AttributeTargets.Property)]
    internal sealed class StubsOwn : Attribute
    {
    }
}
