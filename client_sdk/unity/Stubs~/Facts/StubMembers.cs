using System;
using System.Collections.Generic;
using System.Linq;
using System.Reflection;

namespace Terraport.Stubs
{
    /// <summary>
    /// Prints what assemblies of stubs declare in public, to be compared with facts about Unity: a line for each member with its type, its
    /// signature as the facts write it and its state (ok, obsolete, obsolete-error), tabs between. Operators and events are not in the facts.
    ///
    ///     mono StubMembers.exe LIBRARY ...
    /// </summary>
    public static class StubMembers
    {
        private const BindingFlags Declared = BindingFlags.Public | BindingFlags.Instance | BindingFlags.Static | BindingFlags.DeclaredOnly;

        private static readonly Dictionary<Type, string> Keywords = new Dictionary<Type, string> {
            { typeof(void), "void" },
            { typeof(bool), "bool" },
            { typeof(byte), "byte" },
            { typeof(int), "int" },
            { typeof(uint), "uint" },
            { typeof(long), "long" },
            { typeof(float), "float" },
            { typeof(string), "string" },
            { typeof(object), "object" },
        };

        /// <summary>See the class.</summary>
        public static int Main(string[] libraries)
        {
            foreach (string library in libraries)
            {
                foreach (Type type in Assembly.LoadFrom(library).GetExportedTypes())
                {
                    string name = (type.IsNested ? PlainName(type.DeclaringType) + "." : "") + PlainName(type);
                    Console.WriteLine(name + "\t(type)\t" + StateOf(type));
                    foreach (string line in type.IsEnum ? Values(type) : Members(type))
                    {
                        Console.WriteLine(name + "\t" + line);
                    }
                }
            }
            return 0;
        }

        private static IEnumerable<string> Values(Type type)
        {
            return type.GetFields(BindingFlags.Public | BindingFlags.Static).Select(field => "enum " + field.Name + "\t" + StateOf(field));
        }

        private static IEnumerable<string> Members(Type type)
        {
            foreach (MemberInfo member in type.GetMembers(Declared))
            {
                if (member.GetCustomAttributes(false).Any(mark => mark.GetType().Name == "StubsOwn"))
                {
                    continue;
                }
                string signature = SignatureOf(type, member);
                if (signature != null)
                {
                    yield return signature + "\t" + StateOf(member);
                }
            }
        }

        /// <summary>Null of what has no line of its own: accessors, operators, nested types, overrides, and the constructor that every class has.</summary>
        private static string SignatureOf(Type type, MemberInfo member)
        {
            MethodInfo method = member as MethodInfo;
            if (method != null)
            {
                bool isOverride = method.IsVirtual && method.GetBaseDefinition().DeclaringType == typeof(object);
                return method.IsSpecialName || isOverride
                    ? null
                    : Static(method.IsStatic) + "method " + method.Name + Parameters(method) + " : " + NameOf(method.ReturnType);
            }
            PropertyInfo property = member as PropertyInfo;
            if (property != null && property.GetIndexParameters().Length > 0)
            {
                return "indexer this(" + string.Join(",", property.GetIndexParameters().Select(p => NameOf(p.ParameterType))) + ")";
            }
            if (property != null)
            {
                return Static(property.GetAccessors()[0].IsStatic) + "property " + property.Name + " : " + NameOf(property.PropertyType);
            }
            FieldInfo field = member as FieldInfo;
            if (field != null)
            {
                return Static(field.IsStatic && !field.IsLiteral) + "field " + field.Name + " : " + NameOf(field.FieldType);
            }
            ConstructorInfo constructor = member as ConstructorInfo;
            return constructor != null && constructor.GetParameters().Length > 0 ? "ctor " + PlainName(type) + Parameters(constructor)
                                                                                 : null;
        }

        private static string Static(bool isStatic) { return isStatic ? "static " : ""; }

        private static string Parameters(MethodBase method)
        {
            return "(" + string.Join(",", method.GetParameters().Select(ParameterOf)) + ")";
        }

        private static string ParameterOf(ParameterInfo parameter)
        {
            bool isParams = parameter.GetCustomAttributes(typeof(ParamArrayAttribute), false).Length > 0;
            string name =
                parameter.ParameterType.IsByRef ? NameOf(parameter.ParameterType.GetElementType()) : NameOf(parameter.ParameterType);
            return (parameter.IsOut ? "out " : "") + name + (parameter.IsOptional || isParams ? "=" : "");
        }

        private static string NameOf(Type type)
        {
            string keyword;
            if (Keywords.TryGetValue(type, out keyword))
            {
                return keyword;
            }
            if (type.IsArray)
            {
                return NameOf(type.GetElementType()) + "[]";
            }
            return type.IsGenericType ? PlainName(type) + "<" + string.Join(",", type.GetGenericArguments().Select(NameOf)) + ">"
                                      : PlainName(type);
        }

        private static string PlainName(Type type)
        {
            int tick = type.Name.IndexOf('`');
            return tick < 0 ? type.Name : type.Name.Substring(0, tick);
        }

        private static string StateOf(MemberInfo member)
        {
            ObsoleteAttribute mark = (ObsoleteAttribute)Attribute.GetCustomAttribute(member, typeof(ObsoleteAttribute), false);
            return mark == null ? "ok" : mark.IsError ? "obsolete-error" : "obsolete";
        }
    }
}
